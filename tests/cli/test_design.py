"""``sprintlab design``: resumed where it stopped, as table, map and JSON."""

import json

import pytest

VARIED = ("design", "bp2", "--vary", "gear.hip=6,9", "--vary", "winding=0.8,1", "--workers", 1)


@pytest.fixture
def searched(monkeypatch, tmp_path):
    """Made-up limits, and the names of the robots whose limits were searched for."""
    names = []

    def limit(robot, model, settings, near):
        names.append(robot.name)
        ratio, promise = float(robot.gear.ratio[1]), 0.0 if model == "refined" else 0.5
        speed = 13.0 - 0.1 * ratio + promise * (ratio == 9.0)
        return None, {"speed_m_s": speed, "spread_m_s": 0.0, "power_W": 100.0, "winding_degC": 50.0}

    monkeypatch.setattr("sprintlab.speed_limit.designs.design_limit", limit)
    monkeypatch.chdir(tmp_path)
    return names


def test_a_run_that_was_stopped_goes_on_and_repeats_nothing(call, searched, monkeypatch, tmp_path):
    outcome = call(*VARIED, "--json", "--figure", tmp_path / "map.png")
    whole, folder = json.loads(outcome.out), tmp_path / "runs" / "design" / "bp2"
    assert len(searched) == 8 and (tmp_path / "map.png").stat().st_size > 0
    assert "costs 0.30 m/s" in whole["sentence"]
    (folder / "gear.hip=9,winding=1" / "design.json").unlink()
    searched.clear()
    assert json.loads(call(*VARIED, "--json").out)["designs"] == whole["designs"]
    assert searched == ["bp2-gear.hip=9,winding=1"] * 2
    searched.clear()
    table = call(*VARIED, "--starts", 2).out  # other settings: other numbers
    assert len(searched) == 8 and "without d axis" in table
