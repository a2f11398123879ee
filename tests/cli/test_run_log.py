"""Every run of a robot is logged unless somebody says otherwise."""

from __future__ import annotations

from pathlib import Path

import pytest

from sprintlab.cli import run
from sprintlab.cli.run import Run


@pytest.fixture(autouse=True)
def in_a_folder_of_its_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_a_run_is_logged_into_a_file_of_its_own(monkeypatch, capsys):
    monkeypatch.setattr(run, "find_spec", lambda name: object())
    path = Run()._log_path()
    assert path is not None
    assert path.parent == Path("runs")
    assert path.parent.is_dir()
    assert path.match("run-????????-??????.mcap")
    assert str(path) in capsys.readouterr().err


def test_a_file_that_was_asked_for_is_taken():
    assert Run(log=Path("mine.mcap"))._log_path() == Path("mine.mcap")


def test_no_log_means_none():
    assert Run(no_log=True)._log_path() is None
    assert not Path("runs").exists()


def test_without_mcap_a_line_says_what_to_install(monkeypatch, capsys):
    monkeypatch.setattr(run, "find_spec", lambda name: None)
    assert Run()._log_path() is None
    assert "sprintlab[log]" in capsys.readouterr().err
