"""``sprintlab race`` and ``evaluate``, with a policy that stands still."""

import json
from pathlib import Path

import numpy as np
import pytest

import sprintlab as sl
from sprintlab.evaluation.rollouts import load_rollout
from sprintlab.robots import load_robot

BRIEF = ("--top-speed", 2, "--trials", 1, "--workers", 1, "--no-video", "--distance", 0.5)
SEARCH = ("--start", 0.5, "--top", 0.75, "--trials", 1, "--workers", 1)


@pytest.mark.usefixtures("brief_trials")
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
    assert load_rollout(folder / "trajectory.npz").joint_names == load_robot("bp2").joint_names
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


@pytest.mark.usefixtures("brief_trials")
def test_evaluate_searches_the_highest_speed(call, policy, tmp_path):
    output, figure = tmp_path / "numbers.json", tmp_path / "speeds.svg"
    outcome = call("evaluate", policy, *SEARCH, "--output", output, "--figure", figure, "--json")
    numbers = json.loads(output.read_text())
    assert json.loads(outcome.out) == {**numbers, "figure": str(figure)}
    assert set(numbers) == {"raw", "self_paced", "battery"}
    assert [row["top_speed_command_m_s"] for row in numbers["raw"]["speeds"]] == [0.5, 0.75]
    assert numbers["raw"]["best"]["top_speed_command_m_s"] == 0.75
    assert "commanded top speed" in figure.read_text()


def test_nine_of_ten_trials_are_required():
    from sprintlab.api.evaluations import protocol_settings

    assert [protocol_settings(trials, 0).required for trials in (1, 3, 10, 11)] == [1, 3, 9, 10]
    with pytest.raises(sl.SprintlabError, match="trials"):
        protocol_settings(0, 0)
