"""Arguments as a stranger's JSON has them are refused in one sentence, before any work."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

import sprintlab as sl
from sprintlab.core.errors import InvalidValueError, SprintlabError
from sprintlab.evaluation.trial import TrialRequest

VALUES = (math.nan, -1, 1.5, b"x", [], {}, 1j)


@pytest.mark.parametrize("value", VALUES, ids=lambda value: repr(value)[:12])
@pytest.mark.parametrize(
    ("function", "name"),
    [
        (sl.load_policy, "policy"), (sl.load_robot, "name"), (sl.race, "policy"), (sl.race, "robot"),
        (sl.race, "seed"), (sl.race, "trials"), (sl.race, "workers"), (sl.race, "drive"), (sl.race, "folder"),
        (sl.evaluate, "output"), (sl.evaluate, "search"), (sl.turning, "speeds"), (sl.lap, "recording"),
        (sl.ground, "trials"), (sl.robustness, "cause_trials"), (sl.method, "environments"),
        (sl.method, "changes"), (sl.replay, "run_folders"), (sl.envelope, "source"), (sl.envelope, "points"),
        (sl.envelope, "trajectory"), (sl.actuators, "name"), (sl.doctor, "folder"), (sl.train, "settings"),
        (sl.RobotRun, "policy"), (sl.RobotRun, "options"), (sl.RobotRun, "robot"), (sl.RobotRun, "source"),
        (sl.RobotRun, "log"), (sl.RobotSimulation, "bus"), (sl.RobotSimulation, "pace"),
        (sl.RobotSimulation, "options"), (sl.RobotSimulation, "robot"),
    ],
)  # fmt: skip
def test_an_argument_of_another_kind_is_told_in_one_sentence(function, name, value, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    if (name, value) in (("changes", {}), ("run_folders", [])):
        value = {"no": 1} if name == "changes" else [b"no"]  # an empty one is as good as none
    with pytest.raises(SprintlabError):
        function(**{name: value})
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("value", VALUES, ids=lambda value: repr(value)[:12])
@pytest.mark.parametrize("name", ["source", "choices", "output"])
def test_an_import_names_what_is_no_file(name, value, tmp_path):
    given = {"source": tmp_path / "a.xml", "choices": tmp_path / "a.toml", "output": tmp_path / "robots"}
    with pytest.raises(InvalidValueError, match=f"^{name} = "):
        sl.import_robot(**{**given, name: value})


@pytest.mark.parametrize(
    ("request_", "field"),
    [
        ({"top_speed": 1e308}, "top_speed"),
        ({"top_speed": 1e-300, "distance": 100.0}, "distance"),
        ({"top_speed": 10.0, "distance": 1e7}, "distance"),
    ],
)
def test_a_trial_without_end_is_refused(request_, field):
    """It would be simulated, and kept in memory, for longer than anybody waits."""
    with pytest.raises(InvalidValueError, match=f"trial.{field} = "):
        TrialRequest(**request_)


@pytest.mark.parametrize("grid", [1e-300, 5e-324])
def test_a_grid_of_endless_speeds_is_refused(grid):
    with pytest.raises(InvalidValueError, match=f"grid = {grid} is not allowed"):
        sl.SearchOptions(grid=grid).protocol()


def test_a_race_over_an_endless_distance_is_refused_before_its_search():
    with pytest.raises(InvalidValueError, match="distance = 1e\\+308 is not allowed"):
        sl.race(distance=1e308)


@pytest.mark.parametrize("voltage", [1e308, 1e-308, -1.0])
def test_a_voltage_that_no_bus_has_is_refused(voltage):
    with pytest.raises(InvalidValueError, match="bus_voltage"):
        sl.envelope(bus_voltage=voltage)


def test_a_log_without_what_is_drawn_is_told_in_one_sentence(tmp_path: Path):
    pytest.importorskip("mujoco_warp")
    for text, said in (
        ('{"seconds": 1.0}\n', "the log has rows without falls"),
        ("", "iterations in the log = 0"),
    ):
        (tmp_path / "log.jsonl").write_text(text)
        with pytest.raises(SprintlabError, match=said):
            sl.Training(folder=tmp_path).plot()
