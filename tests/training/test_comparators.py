"""Other papers' methods: what sets them apart, and that each of them trains."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest

pytest.importorskip("mujoco_warp")

import numpy as np
import torch

from sprintlab.control import pd_torque
from sprintlab.core.errors import InvalidValueError, SprintlabError
from sprintlab.motors import Battery
from sprintlab.plant import PreparedDrive
from sprintlab.robots import load_robot
from sprintlab.training.environment.actuator_network import network_torque, read_networks
from sprintlab.training.environment.simulation import BatchSimulation
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
NETWORK = str(Path(__file__).parents[2] / "studies" / "paper" / "actuator_network.npz")
WITH_NETWORK = replace(SMALL, simulation=replace(SMALL.simulation, actuator_network=NETWORK))
SWITCHES = {
    "rlvrl": {"schedule"},
    "lp-acrl": {"schedule"},
    "after-hacl": {"schedule"},
    "hound": {"actuator_model", "schedule", "rewards"},
    "spot-battery": {"simulation"},
    "actuator-network": set(),
    "flux-weakening": {"actuator_model"},
}


def base(name: str) -> TrainingSettings:
    return WITH_NETWORK if COMPARATORS[name].network else SMALL


@pytest.mark.parametrize("name", COMPARATORS)
def test_nothing_but_its_switches_sets_a_method_apart_from_sprint(name: str) -> None:
    ours, theirs = (vars(method_settings(each, base(name))) for each in ("sprint", name))
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


def test_the_networks_torques_are_those_of_plain_layers_and_near_the_drives() -> None:
    robot, networks = load_robot("bp2"), read_networks(NETWORK, 12)
    simulation = BatchSimulation(robot, WITH_NETWORK.simulation, "refined", "cpu")
    torch.manual_seed(0)
    simulation.target += torch.randn_like(simulation.target)
    joints = [int(simulation.mj_model.joint(name).dofadr[0]) for name in robot.joint_names]
    simulation.qvel[:, joints] = 30.0 * torch.randn(16, 12)
    simulation.actuate(0)
    places = [int(simulation.mj_model.joint(name).qposadr[0]) for name in robot.joint_names]
    position, velocity = (
        view.double().numpy() for view in (simulation.qpos[:, places], simulation.qvel[:, joints])
    )
    wanted = np.asarray(
        pd_torque(robot.stiffness, robot.damping, simulation.target.double().numpy(), position, velocity)
    )
    expected = network_torque(networks, wanted, velocity)
    np.testing.assert_allclose(simulation.drive_torque.numpy(), expected, atol=2e-3)
    inside = np.abs(velocity) < 0.8 * networks["no_load_speed"][networks["kind"]]
    law = np.asarray(PreparedDrive(robot, robot.bus_voltage)(wanted, velocity).torque)
    peak = networks["peak_torque"][networks["kind"]]
    assert np.sqrt(np.mean(((expected - law) / peak)[inside] ** 2)) < 0.05


def test_a_network_must_be_there_and_be_one(tmp_path: Path) -> None:
    with pytest.raises(InvalidValueError, match=r"studies\.paper network"):
        method_settings("actuator-network", SMALL)
    with pytest.raises(InvalidValueError, match="battery"):
        method_settings("spot-battery", WITH_NETWORK)
    with pytest.raises(SprintlabError, match="7 joints"):
        read_networks(NETWORK, 7)
    np.savez(tmp_path / "other.npz", kind=np.zeros(12, dtype=int), output_bias=np.zeros(1))
    with pytest.raises(SprintlabError, match="input_weight"):
        read_networks(tmp_path / "other.npz", 12)


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
