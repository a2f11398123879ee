"""``sprintlab design``: resumed where it stopped, as table, map and JSON."""

import json
import sys
from dataclasses import replace

import pytest
from tools.measurement_tables import trained_designs

from sprintlab.api.trained_designs import JUDGE, judged
from sprintlab.robots import read_table, robot_table_path
from sprintlab.speed_limit.designs import write_robot

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


BRIEF = replace(JUDGE, trials=1, required=1, top=1.0, hold=0.5)
TRAINER = """
import pathlib, sys
assert sys.argv[4] == str(pathlib.Path(sys.argv[sys.argv.index("--output") + 1]).parents[1])
(pathlib.Path(sys.argv[sys.argv.index("--output") + 1]) / "policy.onnx").write_text("trained")
"""


def made_up(task):
    """Speeds of policies: those of the design with a gear of 9 promise more than they hold."""
    policy, model = task
    seed, promised = int(policy.parent.name[-1]), model == "simplified-dc" and "gear.hip=9" in str(policy)
    slow = 0.5 if "simplified-dc" in policy.parts else 0.0
    speed = 12.0 + 0.1 * seed - slow + (2.0 if promised else 0.0)
    return {"speed_m_s": speed, "power_W": 100.0, "winding_degC": 50.0}


def test_designs_are_trained_under_both_motor_models_and_judged_with_the_refined_one(
    call, searched, monkeypatch, tmp_path
):
    monkeypatch.setattr(
        "sprintlab.training.runs.sweep.new_interpreter", lambda: [sys.executable, "-c", TRAINER]
    )
    monkeypatch.setattr("sprintlab.api.trained_designs.judged", made_up)
    trained = ("--iterations", 3, "--device", "cpu", "--environments", 8, "--parallel", 4)
    found = json.loads(call(*VARIED, *trained, "--json", "--figure", tmp_path / "map.png").out)
    assert len(list(tmp_path.glob("runs/design/bp2/*/*/seed-[01]/policy.onnx"))) == 16
    numbers = found["designs"][-1]["trained"]["simplified-dc"]
    assert (numbers["speed_m_s"], numbers["believed_m_s"], numbers["seeds"]) == (11.55, 13.55, 2)
    assert "v_d = 0 chooses gear.hip=9,winding=0.8 and believes 13.55" in found["sentence"]
    assert "| 0.8 | 9 | 12.05 m/s | 11.55 m/s | 13.55 m/s |" in trained_designs(found)
    assert "11.55" in call(*VARIED).out  # what is finished is judged without training


@pytest.mark.usefixtures("short_trials")
def test_a_policy_is_judged_once_by_each_motor_model(policy, tmp_path, monkeypatch):
    write_robot(tmp_path / "parameters.toml", "bp2", read_table(robot_table_path("bp2"))[1], "bp2")
    place = tmp_path / "acs" / "seed-0" / "policy.onnx"
    place.parent.mkdir(parents=True)
    place.write_bytes(policy.read_bytes())
    monkeypatch.setattr("sprintlab.api.trained_designs.JUDGE", BRIEF)
    found = judged((place, "refined"))
    assert found["power_W"] > 0.0 and found["winding_degC"] >= 25.0
    monkeypatch.setattr(
        "sprintlab.api.trained_designs.run_protocol_near", lambda *_, **__: pytest.fail("again")
    )
    assert judged((place, "refined")) == found
