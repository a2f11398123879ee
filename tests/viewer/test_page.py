"""The command of the live page; the page itself is tested in test_controls.py."""

import pytest

from sprintlab.cli.main import main

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
