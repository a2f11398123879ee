"""Other papers' methods: what sets them apart from ours."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from tests.training.small import small_settings

from sprintlab.engine import Engine
from sprintlab.robots import load_robot
from sprintlab.training.environment.sprint import SprintEnvironment, engine_options
from sprintlab.training.methods import method_settings
from sprintlab.training.reward_tables import hound_rewards
from sprintlab.training.settings import EstimatorSettings

SMALL = small_settings(
    environments=16,
    mini_batches=1,
    hidden=(16, 8),
    estimator=EstimatorSettings(encoder=(16, 8)),
)
SWITCHES = {
    "rlvrl": {"schedule"},
    "lp-acrl": {"schedule"},
    "hound": {"actuator_model", "schedule", "reward", "reward_sum"},
    "spot-battery": {"simulation"},
    "flux-weakening": {"actuator_model"},
}


@pytest.mark.parametrize("name", SWITCHES)
def test_nothing_but_its_switches_sets_a_method_apart_from_sprint(name: str) -> None:
    ours, theirs = (vars(method_settings(each, SMALL)) for each in ("acs", name))
    assert {field for field in ours if ours[field] != theirs[field]} - {"method"} == SWITCHES[name]


def test_a_motor_that_does_not_saturate_gives_more() -> None:
    settings = method_settings("no-saturation", SMALL)
    assert settings.simulation == replace(SMALL.simulation, saturation=False)
    torques = []
    for each in (SMALL, settings):
        engine = Engine(load_robot("bp2"), engine_options(each), "cpu")
        engine.target += 1.0
        engine.previous_target += 1.0
        engine.step()
        torques.append(engine.torque.abs().mean(0))
    assert (torques[1] != torques[0]).any()


def test_a_battery_sags_under_load_and_is_full_when_a_robot_starts_anew() -> None:
    environment = SprintEnvironment(method_settings("spot-battery", SMALL), "cpu")
    full = environment.engine.bus_voltage.clone()
    for _ in range(10):
        environment.step(torch.randn(16, 12))
    charge = environment.engine.state_of_charge
    assert (environment.engine.bus_voltage < full).any() and (charge < 1.0).all()
    environment.episode_length_buf += 100_000
    environment.step(torch.zeros(16, 12))
    assert (charge > 0.9999).all()


def test_hounds_weights_are_its_papers_over_six() -> None:
    printed = {"diagonal_contact": 1.2, "touchdown": -6.0, "foot_slip": -0.16, "torque": -2e-4}
    for name, weight in printed.items():
        assert hound_rewards()[name].weights == (weight / 6, weight / 6)
