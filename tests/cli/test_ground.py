"""``sprintlab ground``: what it prints and refuses."""

import json

import pytest

from sprintlab.evaluation import ground
from sprintlab.evaluation.ground import GroundResult, GroundTrials

SPEEDS = {"level": 10.0, "uphill": 8.0, "downhill": 10.4, "rough": float("nan")}


@pytest.fixture
def measured(monkeypatch):
    """Numbers as if they had been measured: what is tested is what is made of them."""

    def result(pool, settings, progress):
        grounds = [
            GroundTrials(name=name, trials=2, held_speed=speed, falls=() if speed == speed else ("tilt",) * 2)
            for name, speed in SPEEDS.items()
        ]
        return GroundResult(settings=settings, grounds=tuple(grounds))

    monkeypatch.setattr(ground, "compare_grounds", result)


def test_one_line_a_ground(call, policy, measured):
    outcome = call("ground", policy, "--trials", 2, "--slope", 0.1, "--workers", 1)
    lines = outcome.out.splitlines()
    assert outcome.status == 0 and "10 m/s commanded" in lines[0]
    (uphill,) = (line for line in lines if "10 % uphill" in line)
    assert "2 of 2" in uphill and "-20 %" in uphill and "not met" in uphill
    (downhill,) = (line for line in lines if "10 % downhill" in line)
    assert "+4 %" in downhill and "not met" not in downhill
    (rough,) = (line for line in lines if "±2 cm" in line)
    assert "0 of 2 (tilt)" in rough and "not met" in rough


def test_the_same_as_json(call, policy, measured):
    numbers = json.loads(call("ground", policy, "--trials", 2, "--workers", 1, "--json").out)
    assert [row["ground"] for row in numbers["grounds"]] == list(SPEEDS)
    assert numbers["grounds"][1]["change"] == pytest.approx(-0.2)
    assert numbers["grounds"][3]["held_speed_m_s"] is None
    assert "figure" not in numbers


def test_bad_input_is_refused_before_anything_runs(call, policy):
    assert "ground.top_speed" in call("ground", policy, "--top-speed", 99).err
    assert "ground.slope" in call("ground", policy, "--slope", 2).err
    assert "ground.roughness" in call("ground", policy, "--roughness", -1).err
    assert call("ground", "gallop").status == 2
