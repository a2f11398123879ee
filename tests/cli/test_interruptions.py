"""A command that is asked to terminate tidies up first; one that drives a robot counts what it is asked."""

import os
import signal
import subprocess
import sys
from types import SimpleNamespace

import pytest

from sprintlab.api import robot_bus
from sprintlab.api.interruptions import counted_interruptions, tidy_termination
from sprintlab.deployment.controller.loop import LoopReport
from sprintlab.deployment.controller.modes import Mode

CODE = """
import sys, time
from sprintlab.cli import main as command
from sprintlab.core.files import atomic_directory, reserved_directory

def race(arguments):
    with reserved_directory("race") as folder, atomic_directory(folder) as temporary:
        (temporary / "half").touch()
        print("filling", flush=True)
        while True:  # a signal just before a sleep is seen after it: a long one would outlast the test
            time.sleep(0.05)

command.run_words = race
sys.exit(command.main([]))
"""


@pytest.fixture(autouse=True)
def default_signals():
    """Ctrl-C and the signal of a lost terminal at their defaults: whoever runs the tests may ignore them."""
    before = [signal.signal(signal.SIGHUP, signal.SIG_DFL)]
    before.append(signal.signal(signal.SIGINT, signal.default_int_handler))
    yield
    signal.signal(signal.SIGHUP, before[0])
    signal.signal(signal.SIGINT, before[1])


@pytest.mark.parametrize(
    ("numbers", "counted"),
    [
        (("TERM", "HUP", "HUP"), 1),  # what systemd sends when a session ends
        (("INT", "TERM"), 1),  # a program that hands a Ctrl-C on
        (("HUP", "INT"), 2),
        (("INT", "INT"), 2),
    ],
)
def test_one_request_that_is_told_in_several_signals_counts_once(numbers, counted):
    with counted_interruptions() as count:
        for number in numbers:
            os.kill(os.getpid(), getattr(signal, f"SIG{number}"))
        assert count() == counted


def test_the_status_line_survives_its_terminal(monkeypatch):
    """An error in it would end the loop in full run."""
    controlling, terminal = os.openpty()
    with os.fdopen(terminal, "w") as stream:
        monkeypatch.setattr("sys.stderr", stream)
        controller = SimpleNamespace(commanded_speed=9.0, fault_counts={}, stop_reason="", mode=Mode.RUN)
        with robot_bus._status_line() as show:
            show(controller, LoopReport())
            assert os.read(controlling, 1000)
            os.close(controlling)
            show(controller, LoopReport())


def test_a_race_that_is_terminated_leaves_nothing(tmp_path):
    race = subprocess.Popen([sys.executable, "-c", CODE], cwd=tmp_path, stdout=subprocess.PIPE)
    assert race.stdout is not None and race.stdout.readline() == b"filling\n"
    os.kill(race.pid, signal.SIGHUP)
    race.communicate(timeout=300)
    assert race.returncode == 128 + signal.SIGHUP
    assert not list(tmp_path.iterdir())


class Losing:
    """Python prints what is raised while an object goes away, and goes on."""

    def __del__(self):
        os.kill(os.getpid(), signal.SIGINT)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_run_whose_first_ctrl_c_was_lost_does_not_begin():
    """It came while modules were imported; the robot stood up all the same."""
    driven = []
    with pytest.raises(KeyboardInterrupt), tidy_termination():
        del [Losing()][0]
        with counted_interruptions():
            driven.append(True)
    assert not driven
    with counted_interruptions() as count:  # the next one begins anew
        assert count() == 0
