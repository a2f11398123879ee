"""The policies that come with the package run in the evaluation's plant, each on its robot."""

import json
from pathlib import Path

import numpy as np
import pytest

from sprintlab.control import load_policy, shipped_policies, shipped_policy
from sprintlab.evaluation.trial import Course, TrialRequest, run_course, run_trial
from sprintlab.plant import BaseState
from sprintlab.robots import load_robot

RESULTS = Path(__file__).resolve().parents[2] / "results"


@pytest.mark.parametrize("name", shipped_policies())
def test_it_holds_the_speed_of_its_committed_race(name):
    """Held for 4 s instead of 10, once."""
    race = json.loads((RESULTS / name / "result.json").read_text(encoding="utf-8"))
    policy = load_policy(shipped_policy(name))
    robot = load_robot(policy.contract.robot_name)
    trial = run_trial(policy, robot, TrialRequest(top_speed=race["top_speed_command_m_s"], hold=4.0))
    assert trial.completed
    assert trial.metrics.held_speed == pytest.approx(race["held_speed_m_s"], abs=0.3)


class Stand(Course):
    """Asks for rest for three seconds."""

    longest = 3.0

    def speed(self, time: float, base: BaseState) -> float | None:
        return 0.0 if time < self.longest else None


def test_sprint_stands_when_it_is_asked_to():
    policy = load_policy(shipped_policy("sprint"))
    stand = run_course(
        policy, load_robot("bp2"), TrialRequest(top_speed=1.0, keep_trajectory=True), Stand()
    ).trajectory
    assert stand is not None
    second = stand.time > 2.0
    assert stand.foot_contact[second].all()
    assert np.abs(stand.velocity[second, 0]).max() < 0.1
    assert np.hypot(*(stand.qpos[-1, :2] - stand.qpos[0, :2])) < 0.05
