"""The cloud of a training: what its motors did, from the training's own world to the evaluation's picture."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco_warp")
pytest.importorskip("rsl_rl")

import torch
from studies.paper.training_cloud import load_training_cloud

from sprintlab.motors import torque_limits
from sprintlab.robots import load_robot
from sprintlab.training.environment.sprint import SprintEnvironment
from sprintlab.training.runs import cloud, run
from sprintlab.training.runs.checkpoint import read_checkpoint
from sprintlab.training.runs.cloud import record_cloud, write_cloud
from sprintlab.training.runs.run import TrainOptions, train
from sprintlab.training.runs.runner import Runner
from sprintlab.training.settings import (
    PpoSettings,
    RandomizationSettings,
    SimulationSettings,
    TrainingSettings,
)

SETTINGS = TrainingSettings(
    simulation=SimulationSettings(environments=8),
    ppo=PpoSettings(steps=2, epochs=1, mini_batches=2, hidden=(16,)),
    randomization=RandomizationSettings(strength=0.2, bus_voltage=(0.7, 1.0), resistance=(1.0, 1.5)),
)
FAST = 34.0  # joint speed at which every robot's bus limits hip and knee [rad/s]


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Recordings of eight policy steps."""
    monkeypatch.setattr(cloud, "record_cloud", lambda runner: record_cloud(runner, steps=8))


def thrown(settings: TrainingSettings) -> Runner:
    """Robots in the air whose joints are thrown to a high speed, and driven on, before every policy step."""
    runner = Runner(settings, "cpu", "test")
    environment = runner.environment
    advance: Callable[..., None] = environment.advance

    def throw(*watch: Callable[[int], None]) -> None:
        environment.simulation.qvel[:, environment.kinematics.joint_qvel] = FAST
        environment.simulation.qpos[:, 2] = 2.0
        environment.simulation.target.fill_(30.0)
        environment.simulation.previous_target.fill_(30.0)
        advance(*watch)

    environment.advance = throw  # type: ignore[method-assign]
    return runner


def test_samples_lie_on_the_envelope_of_each_robots_own_motors(tmp_path: Path, short: None) -> None:
    robot = load_robot("bp2")
    write_cloud(thrown(SETTINGS), tmp_path / "cloud.npz")
    seen = load_training_cloud(tmp_path / "cloud.npz")
    assert seen.motor_model == "refined" and seen.robot == robot.name
    assert np.ptp(seen.bus_voltage_factor) > 0.1 and np.ptp(seen.motor_strength) > 0.2
    driven = seen.on_limit & (seen.joint_velocity > 10.0) & (seen.joint_torque > 0.0)
    assert driven.sum() > 50
    motors = replace(
        robot.motors, stator_resistance=robot.motors.stator_resistance * seen.resistance_factor[:, None]
    )
    speed = seen.joint_velocity * np.asarray(robot.gear.ratio)
    _, upper = torque_limits(motors, speed, robot.bus_voltage * seen.bus_voltage_factor[..., None])
    error = np.abs(seen.motor_torque(robot) - upper) / np.asarray(robot.motors.peak_torque)
    assert error[driven].max() < 5e-3  # torque and speed of one moment: a physics step apart would be 0.1
    assert not seen.impossible(robot).any()


def test_an_ideal_motor_is_seen_to_do_the_impossible(tmp_path: Path, short: None) -> None:
    write_cloud(thrown(replace(SETTINGS, actuator_model="square")), tmp_path / "cloud.npz")
    seen = load_training_cloud(tmp_path / "cloud.npz")
    impossible, slow = seen.impossible(load_robot("bp2")), seen.joint_velocity < 5.0
    assert impossible[0].any() and impossible[slow].sum() <= 0.05 * slow.sum()


def test_every_fourth_step_is_watched_at_another_of_its_physics_steps() -> None:
    arrays = record_cloud(Runner(SETTINGS, "cpu", "test"), steps=12)
    timestep = SETTINGS.simulation.timestep
    assert arrays["time"] == pytest.approx([0.0, 0.08 + timestep, 0.16 + 2 * timestep])
    assert arrays["joint_torque"].shape == (3, 8, 12) and arrays["forward_speed"].shape == (3, 8)
    assert np.abs(arrays["joint_torque"]).max() > 1.0


def test_a_full_cloud_stays_small(tmp_path: Path) -> None:
    arrays = record_cloud(Runner(SETTINGS, "cpu", "test"), steps=1)
    noise = np.random.default_rng(0).normal(size=(25, 128, 12))  # nothing compresses worse
    large = ("joint_velocity", "joint_torque", "on_limit")
    whole = {name: (noise > 0 if arrays[name].dtype == bool else noise) for name in large}
    np.savez_compressed(
        tmp_path / "cloud.npz", **{name: value.astype(arrays[name].dtype) for name, value in whole.items()}
    )
    assert (tmp_path / "cloud.npz").stat().st_size < 300_000


@pytest.mark.parametrize(("iterations", "oldest", "expected"), [(0, 0, 0), (3, 0, 6), (3, 4, 2), (9, 0, 10)])
def test_robots_that_have_just_started_run_first(
    monkeypatch: pytest.MonkeyPatch, iterations: int, oldest: int, expected: int
) -> None:
    runner = Runner(SETTINGS, "cpu", "test")
    runner.progress.iteration = iterations
    runner.environment.episode_length_buf[3] = oldest
    steps = []
    monkeypatch.setattr(SprintEnvironment, "advance", lambda _, watch=None: steps.append(watch))
    monkeypatch.setattr(cloud.CloudSampler, "arrays", lambda _: {})
    record_cloud(runner, steps=4, settle=10)
    assert len(steps) == expected + 4
    assert [index for index, watch in enumerate(steps) if watch is not None] == [expected]


def options(folder: Path, **changes: object) -> TrainOptions:
    given = {"environments": 8, "device": "cpu", "tensorboard": False, "settings": SETTINGS}
    return TrainOptions(output=folder, **(given | changes))  # type: ignore[arg-type]


def test_a_run_goes_on_as_if_no_cloud_had_been_recorded(tmp_path: Path, short: None) -> None:
    straight, clouded = tmp_path / "straight", tmp_path / "clouded"
    train(options(straight, iterations=3, cloud=False))
    assert not (straight / "cloud.npz").exists()
    train(options(clouded, iterations=2))
    first = (clouded / "cloud.npz").read_bytes()
    train(options(clouded, iterations=2, resume=True))  # nothing left to do: the same cloud again
    assert (clouded / "cloud.npz").read_bytes() == first
    train(options(clouded, iterations=3, resume=True))
    assert (clouded / "cloud.npz").read_bytes() != first
    states = [read_checkpoint(folder / "checkpoint.pt") for folder in (straight, clouded)]
    for name, value in states[0]["learner"]["actor"].items():
        assert torch.equal(value, states[1]["learner"]["actor"][name]), name
    for name, value in states[0]["environment"].items():
        assert torch.equal(value, states[1]["environment"][name]), name


def test_the_checkpoint_is_there_before_the_cloud_is_tried(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Killed(BaseException):
        """Stands for a signal."""

    def killed(runner: Runner, path: Path) -> None:
        raise Killed

    monkeypatch.setattr(run, "write_cloud", killed)
    with pytest.raises(Killed):
        train(options(tmp_path, iterations=1))
    assert read_checkpoint(tmp_path / "checkpoint.pt")["progress"].iteration == 1
    (tmp_path / ".cloud.npz.half_0z9").touch(mode=0o600)  # as a killed write leaves it
    monkeypatch.undo()
    monkeypatch.setattr(cloud, "record_cloud", lambda runner: record_cloud(runner, steps=1))
    train(options(tmp_path, iterations=1, resume=True))
    assert (tmp_path / "cloud.npz").is_file() and not (tmp_path / ".cloud.npz.half_0z9").exists()
