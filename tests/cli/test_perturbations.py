"""``sprintlab turning``, ``lap``, ``ground`` and ``robustness``, with a policy that stands still."""

import json

import numpy as np
import pytest


@pytest.mark.usefixtures("short_trials")
def test_turning_is_mapped(call, policy, tmp_path, monkeypatch):
    for name, value in {"TURN_TIME": 1.0, "FRACTIONS": (-0.5, 0.5)}.items():
        monkeypatch.setattr(f"sprintlab.evaluation.turning.{name}", value)
    figure = tmp_path / "turning.svg"
    outcome = call("turning", policy, "--speeds", 0, "--workers", 1, "--figure", figure)
    assert outcome.status == 0 and "half of mu g" in outcome.out and "+50 %" in outcome.out
    assert "Falls: 0" in outcome.out and figure.read_text().startswith("<?xml")


@pytest.mark.usefixtures("short_trials")
def test_a_lap_leaves_its_recording(call, policy, tmp_path, monkeypatch):
    # Who stands has failed the sooner, the earlier a lap must be finished.
    monkeypatch.setattr("sprintlab.evaluation.lap.LapCourse.latest_finish", 6.0)  # s
    recording = tmp_path / "lap.npz"
    outcome = call("lap", policy, "--top-speed", 14, "--recording", recording)
    assert f"sprintlab replay {recording}" in " ".join(outcome.out.split())
    with np.load(recording) as arrays:
        assert {"time", "qpos", "command"} <= set(arrays)


@pytest.mark.usefixtures("brief_trials")
def test_robustness_prints_draws_and_goes_on(call, policy, tmp_path):
    trials = ("--trials", 2, "--cause-trials", 1, "--distance", 0.2, "--workers", 1)
    where = ("--output", tmp_path / "sprints")
    picture = ("--figure", tmp_path / "picture.png")
    outcome = call("robustness", policy, "--top-speed", 2, *trials, *where, *picture)
    assert outcome.status == 0
    assert "upright" in outcome.out and "One cause at a time" in outcome.out and "friction" in outcome.out
    assert (tmp_path / "picture.png").stat().st_size > 10_000
    files = {path.name: path.stat().st_mtime_ns for path in (tmp_path / "sprints").iterdir()}
    assert len(files) == 2 + 11 + 1
    numbers = json.loads(call("robustness", policy, *trials, *where, "--json").out)
    assert numbers["trials"] == 2 and numbers["top_speed_command_m_s"] == 2.0
    assert 0.0 <= numbers["share_upright"] <= 1.0 and len(numbers["causes"]) == 10
    assert files == {path.name: path.stat().st_mtime_ns for path in (tmp_path / "sprints").iterdir()}
