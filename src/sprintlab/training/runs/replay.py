"""Recorded runs through an exported policy: what the network really gets to see, step by step."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from sprintlab.commands import heading_command
from sprintlab.control import (
    ESTIMATE_SIZE,
    POLICY_RATE_HZ,
    Measurement,
    Policy,
    PolicyRuntime,
    projected_gravity,
)
from sprintlab.control.policy import Decision
from sprintlab.core.archives import read_arrays
from sprintlab.core.errors import InvalidValueError, SprintlabError
from sprintlab.motors import DriveOutput
from sprintlab.plant import Plant, PlantOptions, TrialSettings
from sprintlab.robots import RobotDescription

FloatArray = npt.NDArray[np.floating[Any]]

_SECONDS = 4.0  # of a run in the plant
_STAND = 0.5  # s before the command rises
_ACCELERATION = 2.0  # m/s^2

_WIDTHS = {"qpos": 7, "angular_velocity": 3, "command": 3}
_PER_JOINT = ("joint_position", "joint_velocity")


class RecordedRun(NamedTuple):
    """Sensors and commands at the policy's rate, ``n`` steps.

    Attributes:
        angular_velocity: body frame [rad/s] ``(n, 3)``.
        gravity: unit vector in the body frame ``(n, 3)``.
        joint_position: [rad] ``(n, joints)``.
        joint_velocity: [rad/s] ``(n, joints)``.
        command: forward, sideways speed [m/s], yaw rate [rad/s] ``(n, 3)``.
    """

    angular_velocity: FloatArray
    gravity: FloatArray
    joint_position: FloatArray
    joint_velocity: FloatArray
    command: FloatArray


class Replay(NamedTuple):
    """What went into a policy's network and came out, ``n`` steps; float32.

    Attributes:
        observation: ``(n, H * 45)``.
        previous_estimate: ``(n, 8)``; zeros for a policy without an estimator.
        action: ``(n, joints)``.
        estimate: ``(n, 8)``, or None for a policy without an estimator.
    """

    observation: FloatArray
    previous_estimate: FloatArray
    action: FloatArray
    estimate: FloatArray | None


def read_recording(path: Path) -> RecordedRun:
    """A run that an evaluation recorded (``trajectory.npz`` or ``profile.npz`` of a race).

    Raises:
        InvalidValueError: the file is no such recording, or holds numbers that are not finite.
    """
    names = ("time", *_WIDTHS, *_PER_JOINT)
    try:
        found = read_arrays(path, names)
        arrays = {name: found[name].astype(np.float64) for name in names}
    except (SprintlabError, KeyError, ValueError) as error:
        raise InvalidValueError(
            "recording", str(path), f"an npz that a race has written ({error})"
        ) from error
    _check_arrays(path, arrays)
    step = float(np.median(np.diff(arrays["time"])))
    if not 1e-6 <= step <= 1.0:
        raise InvalidValueError("recording time", step, "its samples must be 1e-6 to 1 s apart")
    every = round(1.0 / (POLICY_RATE_HZ * step))
    chosen = {name: array[:: max(every, 1)] for name, array in arrays.items()}
    return RecordedRun(
        angular_velocity=chosen["angular_velocity"],
        gravity=np.asarray(projected_gravity(chosen["qpos"][:, 3:7])),
        joint_position=chosen["joint_position"],
        joint_velocity=chosen["joint_velocity"],
        command=chosen["command"],
    )


def run_in_plant(policy: Policy, robot: RobotDescription) -> RecordedRun:
    """A start from standing in the plant, driven by the policy itself, until four seconds or a fall.

    Raises:
        SimulationError: the simulation left the realm of finite numbers.
    """
    plant = Plant(robot, PlantOptions(), TrialSettings())
    runtime = PolicyRuntime(policy, robot)
    steps: list[tuple[FloatArray, ...]] = []
    upright = True
    while upright and plant.time < _SECONDS:
        base = plant.base_state()
        speed = max(0.0, _ACCELERATION * (plant.time - _STAND))
        yaw_rate = float(heading_command(base.heading, base.lateral_offset, speed))
        command, measurement = np.array([speed, 0.0, yaw_rate]), plant.measurement()
        steps.append((*measurement, command))
        targets = np.asarray(runtime.step(measurement, command), dtype=np.float64)
        upright = plant.advance(targets, round(plant.options.motor_rate / POLICY_RATE_HZ), _Blind())
    return RecordedRun(*(np.array(column) for column in zip(*steps, strict=True)))


def replay(policy: Policy, robot: RobotDescription, run: RecordedRun) -> Replay:
    """Send a recorded run through the runtime that drives robots, and keep what its network saw and said.

    Raises:
        ContractMismatchError: the policy was made for another robot.
    """
    listener = _Listener(policy)
    runtime = PolicyRuntime(listener, robot)
    for step in zip(*run, strict=True):
        runtime.step(Measurement(*step[:4]), step[4])
    estimates = [decision.estimate for decision in listener.decisions if decision.estimate is not None]
    return Replay(
        observation=np.concatenate(listener.observations),
        previous_estimate=np.concatenate(listener.previous),
        action=np.concatenate([decision.action for decision in listener.decisions]),
        estimate=np.concatenate(estimates) if estimates else None,
    )


class _Listener(Policy):
    """A policy that remembers its inputs and decisions."""

    def __init__(self, policy: Policy) -> None:
        super().__init__(policy.contract, None)
        self._policy = policy
        self.observations: list[FloatArray] = []
        self.previous: list[FloatArray] = []
        self.decisions: list[Decision] = []

    def decide(self, observation: FloatArray, previous_estimate: FloatArray | None = None) -> Decision:
        """Decide as the policy does."""
        nothing = np.zeros((len(observation), ESTIMATE_SIZE), dtype=np.float32)
        decision = self._policy.decide(observation, previous_estimate)
        self.observations.append(np.asarray(observation, dtype=np.float32))
        self.previous.append(nothing if previous_estimate is None else previous_estimate)
        self.decisions.append(decision)
        return decision


class _Blind:
    """Records nothing."""

    def sample(self, data: Any, drive: DriveOutput, targets: FloatArray) -> None:
        """Look away."""

    def watch_step(self, data: Any) -> None:
        """Look away."""


def _check_arrays(path: str | os.PathLike[str], arrays: dict[str, npt.NDArray[np.float64]]) -> None:
    length = len(arrays["time"])
    if arrays["time"].ndim != 1 or length < 2:
        raise InvalidValueError("recording", str(path), "must hold two samples at least")
    widths = _WIDTHS | dict.fromkeys(_PER_JOINT, arrays["joint_position"].shape[-1])
    for name, width in widths.items():
        array = arrays[name]
        narrow = array.ndim != 2 or array.shape[1] < width or (name != "qpos" and array.shape[1] != width)
        if narrow or len(array) != length or not np.isfinite(array).all():
            raise InvalidValueError(
                f"recording {name}", array.shape, f"must be {length} x {width} finite numbers"
            )
