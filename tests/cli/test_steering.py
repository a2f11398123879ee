"""``sprintlab turning`` and ``sprintlab lap``: what they print, draw and refuse."""

import numpy as np
import pytest
from tests.short_trials import shorten_trials

from sprintlab.evaluation.turning import TurningSettings


@pytest.mark.usefixtures("short_trials")
def test_a_policy_that_stands_is_mapped(call, policy, tmp_path, monkeypatch):
    shorten_trials(monkeypatch.setitem, {TurningSettings: {"turn": 2.0}})
    figure = tmp_path / "turning.svg"
    outcome = call("turning", policy, "--speeds", 0, "--workers", 1, "--figure", figure)
    assert outcome.status == 0 and "half of mu g" in outcome.out and "+50 %" in outcome.out
    assert "Falls: 0" in outcome.out and figure.read_text().startswith("<?xml")


def test_bad_input_is_refused_before_anything_runs(call, policy, tmp_path):
    assert "turning.speeds" in call("turning", policy, "--speeds", 99).err
    assert "lap.top_speed" in call("lap", policy, "--top-speed", 0.5).err
    for command in ("turning", "lap"):
        outcome = call(command, policy, "--figure", tmp_path / "picture.gif")
        assert outcome.status == 2 and ".png" in outcome.err
        assert call(command, "gallop").status == 2


@pytest.mark.usefixtures("short_trials")
def test_a_lap_leaves_its_recording(call, policy, tmp_path, monkeypatch):
    # Who stands has failed the sooner, the earlier a lap must be finished.
    monkeypatch.setattr("sprintlab.evaluation.lap.LapCourse.latest_finish", 6.0)  # s
    recording = tmp_path / "lap.npz"
    outcome = call("lap", policy, "--top-speed", 14, "--recording", recording)
    assert f"sprintlab replay {recording}" in " ".join(outcome.out.split())
    with np.load(recording) as arrays:
        assert {"time", "qpos", "command"} <= set(arrays)
    assert "recording" in call("lap", policy, "--recording", tmp_path / "lap.txt").err


@pytest.mark.usefixtures("short_trials", "full_disk")
def test_a_lap_is_not_lost_with_its_recording(call, policy, tmp_path, monkeypatch):
    monkeypatch.setattr("sprintlab.evaluation.lap.LapCourse.latest_finish", 6.0)  # s
    outcome = call("lap", policy, "--top-speed", 14, "--recording", tmp_path / "lap.npz")
    assert outcome.status == 2 and "lap.npz: No space left on device" in outcome.err
    assert "energy from the bus" in outcome.out and "recording" not in outcome.out
