"""Other papers' methods: what sets them apart, and that each of them trains."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from tests.training.small import small_settings

from sprintlab.core.errors import SprintlabError
from sprintlab.engine import Engine
from sprintlab.robots import load_robot
from sprintlab.training.environment.sprint import SprintEnvironment, engine_options
from sprintlab.training.environment.stride_prior import (
    POSITION_SCALE,
    VELOCITY_SCALE,
    StrideReference,
    read_strides,
)
from sprintlab.training.methods import COMPARATORS, NO_SATURATION, method_settings
from sprintlab.training.reward_tables import hound_rewards
from sprintlab.training.runs.runner import Runner
from sprintlab.training.settings import (
    EstimatorSettings,
    StridePrior,
    TrainingSettings,
)

SMALL = small_settings(
    environments=16,
    mini_batches=1,
    hidden=(16, 8),
    estimator=EstimatorSettings(encoder=(16, 8), decoder=(8, 16)),
)
STUDY = Path(__file__).parents[2] / "studies" / "paper"
WITH_PRIOR = replace(SMALL, prior=StridePrior(file=str(STUDY / "strides.npz")))
SWITCHES = {
    "rlvrl": {"schedule"},
    "lp-acrl": {"schedule"},
    "after-hacl": {"schedule"},
    "hound": {"actuator_model", "schedule", "reward", "reward_sum"},
    "stride-prior": {"reward"},
}


def base(name: str) -> TrainingSettings:
    return WITH_PRIOR if COMPARATORS[name].prior else SMALL


@pytest.mark.parametrize("name", COMPARATORS)
def test_nothing_but_its_switches_sets_a_method_apart_from_sprint(name: str) -> None:
    ours, theirs = (vars(method_settings(each, base(name))) for each in ("acs", name))
    assert {field for field in ours if ours[field] != theirs[field]} - {"method"} == SWITCHES[name]
    assert COMPARATORS[name].source


def test_a_motor_that_does_not_saturate_gives_more() -> None:
    settings = method_settings(NO_SATURATION, SMALL)
    assert settings.simulation == replace(SMALL.simulation, saturation=False)
    torques = []
    for each in (SMALL, settings):
        engine = Engine(load_robot("bp2"), engine_options(each), "cpu")
        engine.target += 1.0
        engine.previous_target += 1.0
        engine.step()
        torques.append(engine.torque.abs().mean(0))
    assert (torques[1] != torques[0]).any()


def test_hounds_weights_are_its_papers_over_six() -> None:
    printed = {"diagonal_contact": 1.2, "touchdown": -6.0, "foot_slip": -0.16, "torque": -2e-4}
    for name, weight in printed.items():
        assert hound_rewards()[name].weights == (weight / 6, weight / 6)


@pytest.mark.parametrize("change", [{"state": np.zeros((5, 0, 4))}, {"speed": np.arange(-5.0, 0.0)}])
def test_strides_without_points_or_backward_are_refused(tmp_path, change):
    with np.load(STUDY / "strides.npz") as archive:
        np.savez(tmp_path / "a.npz", **{**archive, **change})
    with pytest.raises(SprintlabError, match="is no file of strides"):
        read_strides(tmp_path / "a.npz")


def test_the_likeness_to_a_stride_is_that_of_a_plain_loop_and_fades() -> None:
    prior, robot = WITH_PRIOR.prior, load_robot("bp2")
    assert prior is not None
    speeds, states = read_strides(prior.file)
    environment = SprintEnvironment(WITH_PRIOR, "cpu")
    torch.manual_seed(0)
    running = torch.linspace(-0.7, 13.9, 16)
    body = environment.kinematics.read()
    body = body._replace(
        joint_position=body.joint_position + 0.3 * torch.randn(16, 12),
        joint_velocity=5.0 * torch.randn(16, 12),
    )
    expected = []
    for each, speed in enumerate(running.tolist()):
        stride = states[int(np.abs(speeds - speed).argmin())]
        likeness = []
        for leg in range(4):
            hip, knee = 3 * leg + 1, 3 * leg + 2
            distance = [
                ((body.joint_position[each, hip].item() - point[0]) / POSITION_SCALE) ** 2
                + ((body.joint_position[each, knee].item() - point[1]) / POSITION_SCALE) ** 2
                + ((body.joint_velocity[each, hip].item() - point[2]) / VELOCITY_SCALE) ** 2
                + ((body.joint_velocity[each, knee].item() - point[3]) / VELOCITY_SCALE) ** 2
                for point in stride
            ]
            likeness.append(math.exp(-min(distance)))
        expected.append(sum(likeness) / 4 if speed > 0.5 * speeds[0] else 0.0)
    found = StrideReference(prior, robot, "cpu").likeness(body, running)
    assert found.tolist() == pytest.approx(expected, abs=1e-4) and max(expected) > 0.05
    assert [prior.weight_at(iteration) for iteration in (0, 800, 1200, 5000)] == [0.5, 0.5, 0.25, 0.0]


def test_the_strides_are_possible_ones_within_the_joints_range() -> None:
    robot = load_robot("bp2")
    speeds, states = read_strides(STUDY / "strides.npz")
    lower, upper = robot.position_limits[1:3].T
    assert speeds[0] < 6.0 < 11.0 < speeds[-1]
    assert (states[..., :2] > lower - 0.1).all() and (states[..., :2] < upper + 0.1).all()


@pytest.mark.parametrize("name", COMPARATORS)
def test_each_trains(name: str) -> None:
    """Two iterations: numbers, not speed."""
    torch.manual_seed(0)
    runner = Runner(method_settings(name, base(name)), "cpu", "test", fused=False)
    first = [value.clone() for value in runner.learner.actor.parameters()]
    rows = [runner.iterate() for _ in range(2)]
    assert all(math.isfinite(value) for row in rows for value in row.values())
    assert all(torch.isfinite(value).all() for value in runner.learner.actor.parameters())
    assert any(
        not torch.equal(old, new) for old, new in zip(first, runner.learner.actor.parameters(), strict=True)
    )
