"""Streams that are closed, full or read by nobody end no work of a command."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from sprintlab.cli.status import exit_status

CODE = """
import os, sys
from sprintlab.cli.status import exit_status

def work():
    print("said")
    print("said", file=sys.stderr)
    return 0 if min(os.open("log", os.O_CREAT), sys.stderr.fileno()) >= 2 else 5

sys.exit(exit_status("command", work))
"""


def failing(kind: str):
    if kind == "full":
        return open("/dev/full", "w", encoding="utf-8")
    reading, writing = os.pipe()
    os.close(reading)
    return open(writing, "w", encoding="utf-8")


@pytest.mark.parametrize("kind", ["full", "nobody reads"])
def test_what_stderr_does_not_take_ends_no_work(kind, monkeypatch):
    """A training ended with the reader of its progress, up to a minute after its last checkpoint."""
    stream = failing(kind)
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setattr(sys, "__stderr__", stream)
    done = []

    def work():
        for _ in range(1000):
            print("iteration " * 20, file=sys.stderr)
        done.append(True)
        return 0

    assert exit_status("command", work) == 0 and done
    assert sys.stderr is stream


@pytest.mark.parametrize("closed", ["<&-", ">&-", "2>&-", "<&- >&- 2>&-"])
def test_no_file_takes_the_number_of_a_stream_that_is_closed(closed, tmp_path):
    command = f'exec "$0" -c "$1" {closed}'
    path = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    ended = subprocess.run(["sh", "-c", command, sys.executable, CODE], cwd=tmp_path, env=path, check=False)
    assert ended.returncode == 0
    assert Path(tmp_path, "log").stat().st_size == 0


def test_what_the_encoding_of_stdout_cannot_say_appears_as_its_code(tmp_path):
    """A robot's folder of that name ended the list of all robots in a traceback, and a race its numbers."""
    code = CODE.replace('print("said")', r'print("\u673a\udcff")')
    path = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "PYTHONIOENCODING": "latin-1"}
    ended = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env=path, capture_output=True, text=True, check=False
    )
    assert (ended.returncode, ended.stdout) == (0, "\\u673a\\udcff\n")
