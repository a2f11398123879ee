"""Every run of a robot is logged unless told otherwise."""

from __future__ import annotations

from pathlib import Path

import pytest

from sprintlab.api import robot_runs
from sprintlab.api.robot_runs import log_path


@pytest.fixture(autouse=True)
def in_a_folder_of_its_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_a_run_is_logged_into_a_file_of_its_own(monkeypatch):
    monkeypatch.setattr(robot_runs, "find_spec", lambda name: object())
    path = log_path(True, "unitree://go2@10.0.0.7")
    assert path is not None
    assert path.parent == Path("runs")
    assert path.match("go2-10-0-0-7-????????-??????.mcap")


def test_a_file_that_was_asked_for_is_taken():
    pytest.importorskip("mcap")
    assert log_path(Path("mine.mcap"), "shm://bp2") == Path("mine.mcap")


def test_where_no_robot_runs_no_log_is_left_behind(call):
    assert call("run", "sprint", "shm://not-here").status == 2
    assert not list(Path().rglob("*.mcap"))


def test_no_log_means_none():
    assert log_path(False, "shm://bp2") is None
    assert not Path("runs").exists()


def test_without_mcap_a_line_says_what_to_install(monkeypatch):
    said = []
    monkeypatch.setattr(robot_runs, "find_spec", lambda name: None)
    assert log_path(True, "shm://bp2", said.append) is None
    assert "sprintlab[log]" in said[0]
