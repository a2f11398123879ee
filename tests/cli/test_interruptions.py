"""A command that is asked to terminate tidies up first."""

import os
import signal
import subprocess
import sys

from sprintlab.cli.interruptions import TERMINATED

CODE = """
import sys, time
from sprintlab.cli import main as command
from sprintlab.core.files import atomic_directory, reserved_directory

def race(arguments):
    with reserved_directory("race") as folder, atomic_directory(folder) as temporary:
        (temporary / "half").touch()
        print("filling", flush=True)
        time.sleep(600)

command.run = race
sys.exit(command.main([]))
"""


def test_a_race_that_is_terminated_leaves_nothing(tmp_path):
    race = subprocess.Popen([sys.executable, "-c", CODE], cwd=tmp_path, stdout=subprocess.PIPE)
    assert race.stdout is not None and race.stdout.readline() == b"filling\n"
    os.kill(race.pid, signal.SIGTERM)
    race.communicate(timeout=60)
    assert race.returncode == TERMINATED == 143
    assert not list(tmp_path.iterdir())
