"""The live page in a real browser."""

import signal
import subprocess
import sys

import pytest

from sprintlab import control
from sprintlab.api.replays import live_session
from sprintlab.cli.main import main, parse

pytest.importorskip("viser", reason="needs viser: pip install 'sprintlab[play]'")


def test_duration_ends_the_command(capsys):
    assert main(["play", "--port", "8240", "--duration", "0.3"]) == 0
    assert capsys.readouterr().out.count("http://localhost:") == 1


@pytest.mark.parametrize(
    "arguments",
    [
        ("no-such-policy",),
        ("--gamepad", "no-such-device"),
        ("--port", "70000"),
        ("--host", "no such host"),
        ("--host", "8.8.8.8"),
        ("sprint", "--robot", "go1"),
        ("sprint", "go1-sprint"),
    ],
    ids=["no policy", "no pad", "no port", "no host", "elsewhere", "other robot", "two robots"],
)
def test_what_cannot_be_served_is_refused_with_one_sentence(arguments, capsys):
    assert main(["play", *arguments]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert len(printed.err.splitlines()) == 1


def test_the_robot_is_the_first_policy_s_and_each_policy_is_opened_once(monkeypatch):
    opened, load = [], control.load_policy
    monkeypatch.setattr(control, "load_policy", lambda path: opened.append(path.stem) or load(path))
    for arguments, robot, policies in (
        (["go1-sprint"], "go1", ["go1-sprint"]),
        (["--robot", "go1"], "go1", ["go1-sprint"]),
        (["sprint"], "bp2", ["sprint"]),
        ([], "bp2", ["sprint"]),
    ):
        _, given = parse(["play", *arguments])
        session = live_session(given["policies"], given["robot"])
        assert session.robot.name == robot
        assert list(session.policy_names) == policies
        assert len(opened) == len(set(opened)) and set(opened) >= set(policies)
        opened.clear()


def test_interrupt_ends_the_command_as_done():
    command = [sys.executable, "-m", "sprintlab.cli.main", "play", "--port", "8250"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, **pipes, preexec_fn=_heed_interrupts) as process:
        try:
            assert "http://localhost:" in process.stdout.readline()
            process.send_signal(signal.SIGINT)
            assert process.communicate(timeout=120.0)[1] == ""
        finally:
            process.kill()
        assert process.returncode == 0


def _heed_interrupts():
    """A shell's background jobs ignore them, and with them whatever the tests start."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
