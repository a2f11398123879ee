"""The command of the live page; the page itself is tested in test_controls.py."""

import pytest

from sprintlab.cli.main import main

pytest.importorskip("viser", reason="needs viser: pip install 'sprintlab[play]'")


def test_duration_ends_the_command(capsys):
    assert main(["play", "--port", "8240", "--duration", "0.3"]) == 0
    assert capsys.readouterr().out.count("http://localhost:") == 1
