"""``sprintlab race`` and ``evaluate``, with a policy that stands still."""

import json
import os
import re
from pathlib import Path

import numpy as np
import pytest

import sprintlab as sl
from sprintlab.core.errors import SprintlabError
from sprintlab.evaluation import race
from sprintlab.robots import load_robot, robot_fingerprint
from sprintlab.robots.loader import robot_table_path

BRIEF = ("--top-speed", 2, "--trials", 1, "--workers", 1, "--no-video", "--distance", 0.5)
SEARCH = ("--start", 0.5, "--top", 0.75, "--trials", 1, "--workers", 1, "--common-speed", 0.5)


@pytest.mark.usefixtures("brief_trials", "light_pictures")
def test_race_leaves_a_complete_folder(call, policy, tmp_path):
    folder = tmp_path / "run"
    outcome = call("race", policy, "--output", folder, *BRIEF)
    assert outcome.status == 0
    assert "not finished" in outcome.out and str(folder / "report.html") in outcome.out
    assert "\x1b" not in outcome.out
    figures = {f"{name}.png" for name in ("sprint", "speed", "torque_speed", "gait", "base_rates", "power")}
    pages = {"report.html", "replay.html", "result.json", "trajectory.npz", "profile.npz"}
    assert {path.name for path in folder.iterdir()} == figures | pages
    assert [path.name for path in tmp_path.iterdir()] == ["run"]
    numbers = json.loads((folder / "result.json").read_text())
    assert numbers["time_100m_s"] is None and numbers["falls"] == 0
    assert len(numbers["facts"]["policy SHA-256"]) == 64
    with np.load(folder / "trajectory.npz") as archive:
        assert archive["motor_torque"].shape == (len(archive["time"]), 12)
    refused = call("race", policy, "--output", folder, *BRIEF)
    assert refused.status == 2 and "exists already" in refused.err


@pytest.mark.usefixtures("computed", "blank_pictures")
def test_race_prints_json_only_and_writes_nothing_where_no_report_is_wanted(
    call, policy, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    numbers = json.loads(call("race", policy, "--no-report", "--json").out)
    assert numbers["held_speed_m_s"] is not None and "folder" not in numbers
    assert not list(tmp_path.iterdir())
    numbers = json.loads(call("race", policy, "--no-video", "--json").out)
    assert Path(numbers["folder"]).match("runs/race-*") and Path(numbers["folder"], "report.html").is_file()


@pytest.mark.parametrize("change", ["edited", "gone"])
@pytest.mark.usefixtures("blank_pictures")
def test_a_report_is_of_the_robot_that_ran_whatever_becomes_of_its_table(
    call, policy, tmp_path, monkeypatch, computed, change
):
    table, folder, drawn = tmp_path / "mine.toml", tmp_path / "run", []
    table.write_text(written := robot_table_path("bp2").read_text())

    def and_then_changed(*_, **__):
        table.unlink()
        if change == "edited":
            table.write_text(written.replace("length = { value = 0.31", "length = { value = 0.36"))
        return computed

    monkeypatch.setattr(race, "evaluate_race", and_then_changed)
    write = "sprintlab.viewer.replay.write_replay"
    monkeypatch.setattr(write, lambda page, arrays, robot, text: drawn.append(robot_fingerprint(robot)))
    outcome = call("race", policy, "--robot", table, "--output", folder, "--top-speed", 2, "--no-video")
    assert outcome.status == 0
    assert drawn == [robot_fingerprint(load_robot("bp2"))]
    assert (folder / "report.html").is_file()


@pytest.mark.parametrize(("policy_name", "robot_name"), [("sprint", "bp2"), ("go1-sprint", "go1")])
def test_the_robot_follows_from_the_policy(call, monkeypatch, policy_name, robot_name):
    def evaluate_only_in_name(_policy, robot, **_settings):
        raise SprintlabError(f"this would run {robot.name}")

    monkeypatch.setattr("sprintlab.evaluation.race.evaluate_race", evaluate_only_in_name)
    outcome = call("race", policy_name, "--top-speed", 2, "--no-report")
    assert outcome.status == 2 and f"this would run {robot_name}" in outcome.err


@pytest.mark.usefixtures("brief_trials")
def test_evaluate_searches_the_highest_speed(call, policy, tmp_path, run_once):
    run_once("sprintlab.evaluation.pool.run_request")
    outcome = call("evaluate", policy, *SEARCH, "--output", tmp_path / "numbers.json")
    numbers = json.loads((tmp_path / "numbers.json").read_text())
    assert set(numbers) == {"raw", "self_paced", "battery"}
    assert [row["top_speed_command_m_s"] for row in numbers["raw"]["speeds"]] == [0.5, 0.75]
    assert numbers["raw"]["best"]["top_speed_command_m_s"] == 0.75
    assert numbers["raw"]["J_common_rad2_s"] >= 0.0
    assert numbers["raw"]["fastest"] in numbers["raw"]["speeds"]
    assert numbers["raw"]["fastest_with_audit_passed"] is not None
    assert re.search(r"max velocity +\S+ +\S+ +m/s", outcome.out)
    assert re.search(r"J common +\S+ +\S+ +rad²/s", outcome.out)
    figure = tmp_path / "speeds.svg"
    again = call("evaluate", policy, *SEARCH, "--json", "--figure", figure)
    assert json.loads(again.out) == {**numbers, "figure": str(figure)}
    assert "commanded top speed" in figure.read_text()


@pytest.mark.usefixtures("brief_trials", "full_disk")
def test_an_evaluation_is_not_lost_with_its_file(call, policy, tmp_path, run_once):
    run_once("sprintlab.evaluation.pool.run_request")
    outcome = call("evaluate", policy, *SEARCH, "--output", tmp_path / "numbers.json", "--json")
    assert outcome.status == 2 and "numbers.json: No space left on device" in outcome.err
    assert [row["top_speed_command_m_s"] for row in json.loads(outcome.out)["raw"]["speeds"]] == [0.5, 0.75]
    assert list(tmp_path.iterdir()) == [] and os.path.exists(policy)


@pytest.mark.parametrize(
    ("grid", "first"), [(0.25, 1.0), (0.5, 1.0), (0.3, None), (1.0, None), (0.0, None), (5e-324, None)]
)
def test_a_search_walks_whole_speeds_first_where_they_are_on_the_grid(grid, first):
    from sprintlab.api.evaluations import first_step

    assert first_step(grid) == first and first_step(grid, every_speed=True) is None


def test_nine_of_ten_trials_are_required():
    from sprintlab.api.evaluations import protocol_settings

    assert [protocol_settings(trials, 0).required for trials in (1, 3, 10, 11)] == [1, 3, 9, 10]
    with pytest.raises(sl.SprintlabError, match="trials"):
        protocol_settings(0, 0)
