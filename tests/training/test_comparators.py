"""Other papers' methods: what sets them apart, and that each of them trains."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

pytest.importorskip("mujoco_warp")

import torch

from sprintlab.core.errors import InvalidValueError
from sprintlab.motors import Battery
from sprintlab.training.methods import COMPARATORS, hound_rewards, method_settings, preset_settings
from sprintlab.training.runs.runner import Runner
from sprintlab.training.settings import (
    EstimatorSettings,
    PpoSettings,
    SimulationSettings,
    TrainingSettings,
)

SMALL = TrainingSettings(
    simulation=SimulationSettings(environments=16),
    ppo=PpoSettings(steps=2, epochs=1, mini_batches=1, hidden=(16, 8)),
    estimator=EstimatorSettings(encoder=(16, 8), decoder=(8, 16)),
)
SWITCHES = {
    "rlvrl": {"schedule"},
    "lp-acrl": {"schedule"},
    "after-hacl": {"schedule"},
    "hound": {"actuator_model", "schedule", "rewards"},
    "spot-battery": {"simulation"},
    "flux-weakening": {"actuator_model"},
}


@pytest.mark.parametrize("name", COMPARATORS)
def test_nothing_but_its_switches_sets_a_method_apart_from_sprint(name: str) -> None:
    ours, theirs = vars(method_settings("sprint", SMALL)), vars(method_settings(name, SMALL))
    assert {field for field in ours if ours[field] != theirs[field]} - {"method"} == SWITCHES[name]
    assert COMPARATORS[name].source


def test_a_battery_leaves_the_rest_of_the_simulation() -> None:
    simulation = method_settings("spot-battery", SMALL).simulation
    assert simulation == replace(SMALL.simulation, battery=Battery())


def test_hounds_weights_are_its_papers_over_six_and_stay_as_they_are() -> None:
    rewards = hound_rewards()
    printed = {"diagonal_contact": 1.2, "touchdown": -6.0, "foot_slip": -0.16, "torque": -2e-4}
    for name, weight in printed.items():
        assert rewards.penalties()[name].first == rewards.penalties()[name].second == weight / 6
    assert method_settings("hound", method_settings("hound", SMALL)).rewards == rewards
    with pytest.raises(InvalidValueError, match="hound"):
        method_settings("hound", preset_settings("paper"))


@pytest.mark.parametrize("name", COMPARATORS)
def test_each_trains(name: str) -> None:
    """Two iterations: numbers, not speed."""
    torch.manual_seed(0)
    runner = Runner(method_settings(name, SMALL), "cpu", "test", fused=False)
    first = [value.clone() for value in runner.learner.actor.parameters()]
    rows = [runner.iterate() for _ in range(2)]
    assert all(math.isfinite(value) for row in rows for value in row.values())
    assert all(torch.isfinite(value).all() for value in runner.learner.actor.parameters())
    assert any(
        not torch.equal(old, new) for old, new in zip(first, runner.learner.actor.parameters(), strict=True)
    )
