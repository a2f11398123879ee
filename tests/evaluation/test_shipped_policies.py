"""The policies that come with the package run in the evaluation's plant, each on its robot."""

import csv
from pathlib import Path
from typing import NamedTuple

import pytest

from sprintlab.control import load_policy, shipped_policy
from sprintlab.control.policy import SHIPPED_POLICIES
from sprintlab.evaluation.trial import TrialRequest, run_trial
from sprintlab.robots import load_robot

RESULTS = Path(__file__).resolve().parents[2] / "results"


class Known(NamedTuple):
    """What a policy holds [m/s] at a command [m/s] for so long [s], and what of the audit it fails there."""

    command: float
    held: float
    hold: float = 2.0
    failed: frozenset[str] = frozenset()


TAP = frozenset(
    {
        "stance",
        "touchdowns per stride and foot",
        "foot force",
        "gear torque",
        "speed when it should stand",
    }
)
"""What policies fail that were trained before the audit asked for it."""

KNOWN = {
    "sprint": Known(5.0, 5.4, failed=TAP),
    "sprint-fast": Known(13.0, 13.4, 4.0, TAP | {"stride period from policy clock", "pad deflection"}),
    "runner": Known(10.0, 10.2, 4.0, frozenset({"stride period from policy clock"})),
    "go1-sprint": Known(6.0, 6.0, failed=TAP),
}


@pytest.mark.parametrize("name", sorted(path.stem for path in SHIPPED_POLICIES.glob("*.onnx")))
def test_it_holds_its_speed(name):
    policy = load_policy(shipped_policy(name))
    robot = load_robot(policy.contract.robot_name)
    known = KNOWN[name]
    trial = run_trial(policy, robot, TrialRequest(top_speed=known.command, hold=known.hold))
    assert trial.completed
    assert trial.metrics.held_speed == pytest.approx(known.held, abs=0.3)
    assert {item.name for item in trial.audit.items if not item.passed} <= known.failed


@pytest.mark.parametrize(("name", "curve"), [("go1-sprint", "go1-sprint/learning_curve.csv")])
def test_its_learning_curve_ends_where_its_contract_says(name, curve):
    record = load_policy(shipped_policy(name)).contract.training
    with (RESULTS / curve).open(newline="") as file:
        last = list(csv.DictReader(file))[-1]
    assert int(last["iteration"]) == record.iterations
    assert int(last["environment_steps"]) == record.environment_steps
