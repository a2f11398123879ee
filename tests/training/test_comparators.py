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
from sprintlab.motors import Battery, PreparedDrive
from sprintlab.robots import load_robot
from sprintlab.training.environment.actuator_network import network_torque, read_networks
from sprintlab.training.environment.simulation import BatchSimulation
from sprintlab.training.environment.sprint import SprintEnvironment
from sprintlab.training.environment.stride_prior import StrideReference, read_strides
from sprintlab.training.methods import (
    COMPARATORS,
    NO_SATURATION,
    hound_rewards,
    method_settings,
    preset_settings,
)
from sprintlab.training.runs.options import TrainOptions
from sprintlab.training.runs.run_file import read_run_file, run_text
from sprintlab.training.runs.runner import Runner
from sprintlab.training.settings import (
    EstimatorSettings,
    PpoSettings,
    SimulationSettings,
    StridePrior,
    TrainingSettings,
)

SMALL = TrainingSettings(
    simulation=SimulationSettings(environments=16),
    ppo=PpoSettings(steps=2, epochs=1, mini_batches=1, hidden=(16, 8)),
    estimator=EstimatorSettings(encoder=(16, 8), decoder=(8, 16)),
)
STUDY = Path(__file__).parents[2] / "studies" / "paper"
NETWORK = str(STUDY / "actuator_network.npz")
WITH_PRIOR = replace(SMALL, prior=StridePrior(file=str(STUDY / "strides.npz")))
WITH_NETWORK = replace(SMALL, simulation=replace(SMALL.simulation, actuator_network=NETWORK))
SWITCHES = {
    "rlvrl": {"schedule"},
    "lp-acrl": {"schedule"},
    "after-hacl": {"schedule"},
    "hound": {"actuator_model", "schedule", "rewards"},
    "spot-battery": {"simulation"},
    "actuator-network": set(),
    "stride-prior": {"rewards"},
    "flux-weakening": {"actuator_model"},
}


def base(name: str) -> TrainingSettings:
    if COMPARATORS[name].prior:
        return WITH_PRIOR
    return WITH_NETWORK if COMPARATORS[name].network else SMALL


@pytest.mark.parametrize("name", COMPARATORS)
def test_nothing_but_its_switches_sets_a_method_apart_from_sprint(name: str) -> None:
    ours, theirs = (vars(method_settings(each, base(name))) for each in ("sprint", name))
    assert {field for field in ours if ours[field] != theirs[field]} - {"method"} == SWITCHES[name]
    assert COMPARATORS[name].source


@pytest.mark.parametrize("name", COMPARATORS)
def test_a_runs_file_trains_the_same_again(name: str, tmp_path: Path) -> None:
    settings = method_settings(name, base(name))
    options = TrainOptions(method=name, environments=16, settings=base(name))
    (tmp_path / "run.toml").write_text(run_text(options, settings, "typed"))
    assert read_run_file(tmp_path / "run.toml").full_settings() == settings


def test_a_battery_leaves_the_rest_of_the_simulation() -> None:
    simulation = method_settings("spot-battery", SMALL).simulation
    assert simulation == replace(SMALL.simulation, battery=Battery())


def test_a_motor_that_does_not_saturate_gives_more() -> None:
    settings = method_settings(NO_SATURATION, SMALL).simulation
    assert settings == replace(SMALL.simulation, saturation=False)
    torques = []
    for each in (SMALL.simulation, settings):
        simulation = BatchSimulation(load_robot("bp2"), each, "refined", "cpu")
        simulation.target += 1.0
        simulation.actuate(0)
        torques.append(simulation.drive_torque.abs())
    assert (torques[1] > 1.1 * torques[0]).all()


def test_hounds_weights_are_its_papers_over_six_and_stay_as_they_are() -> None:
    rewards = hound_rewards()
    printed = {"diagonal_contact": 1.2, "touchdown": -6.0, "foot_slip": -0.16, "torque": -2e-4}
    for name, weight in printed.items():
        assert rewards.penalties()[name].first == rewards.penalties()[name].second == weight / 6
    assert method_settings("hound", method_settings("hound", SMALL)).rewards == rewards
    with pytest.raises(InvalidValueError, match="hound"):
        method_settings("hound", preset_settings("paper"))


def test_the_networks_torques_are_those_of_plain_layers_and_near_the_drives() -> None:
    robot, networks = load_robot("bp2"), read_networks(NETWORK, load_robot("bp2"))
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
    law = np.asarray(PreparedDrive(robot.motors, robot.gear, robot.bus_voltage)(wanted, velocity).torque)
    peak = networks["peak_torque"][networks["kind"]]
    assert np.sqrt(np.mean(((expected - law) / peak)[inside] ** 2)) < 0.05


def test_a_network_must_be_there_and_be_one(tmp_path: Path) -> None:
    with pytest.raises(InvalidValueError, match=r"studies\.paper network"):
        method_settings("actuator-network", SMALL)
    with pytest.raises(InvalidValueError, match="battery"):
        method_settings("spot-battery", WITH_NETWORK)
    with pytest.raises(InvalidValueError, match=r"studies\.paper stride"):
        method_settings("stride-prior", SMALL)
    with pytest.raises(SprintlabError, match="other drives than go1's"):
        read_networks(NETWORK, load_robot("go1"))
    np.savez(tmp_path / "other.npz", kind=np.zeros(12, dtype=int), output_bias=np.zeros(1))
    with pytest.raises(SprintlabError, match="input_weight"):
        read_networks(tmp_path / "other.npz", load_robot("bp2"))
    with pytest.raises(SprintlabError, match="no file of strides"):
        read_strides(tmp_path / "other.npz")


@pytest.mark.parametrize("value", ["text", np.inf, 1e300])
@pytest.mark.parametrize("name", ["hidden_weight", "peak_torque", "speed", "state"])
def test_numbers_that_no_file_of_ours_holds_are_refused(tmp_path, name, value):
    """1e300 is finite, and infinite in the kernel's 32 bits."""
    file, read = (
        (STUDY / "strides.npz", read_strides)
        if name in ("speed", "state")
        else (NETWORK, lambda path: read_networks(path, load_robot("bp2")))
    )
    with np.load(file) as archive:
        arrays = dict(archive)
    shape = arrays[name].shape
    arrays[name] = np.full(shape, "1") if value == "text" else np.maximum(arrays[name], value)
    np.savez(tmp_path / "a.npz", **arrays)
    with pytest.raises(SprintlabError, match=r"is no (actuator network|file of strides)"):
        read(tmp_path / "a.npz")


@pytest.mark.parametrize("shape", [(1, 1_000_000, 4), (101, 1, 4)])
def test_strides_that_take_all_memory_are_refused(tmp_path, shape):
    """Four packed kilobytes asked for 131 GB in the first step."""
    speed = np.arange(1.0, 1.0 + shape[0])
    np.savez_compressed(tmp_path / "a.npz", speed=speed, state=np.zeros(shape, dtype=np.int8))
    with pytest.raises(SprintlabError, match="holds more than 100 strides of 1000 points"):
        read_strides(tmp_path / "a.npz")


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
                ((body.joint_position[each, hip].item() - point[0]) / prior.position_scale) ** 2
                + ((body.joint_position[each, knee].item() - point[1]) / prior.position_scale) ** 2
                + ((body.joint_velocity[each, hip].item() - point[2]) / prior.velocity_scale) ** 2
                + ((body.joint_velocity[each, knee].item() - point[3]) / prior.velocity_scale) ** 2
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
