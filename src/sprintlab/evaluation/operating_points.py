"""Where a recorded run, or a training, worked in the torque-speed plane of a joint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sprintlab.core.archives import read_arrays
from sprintlab.core.errors import InvalidValueError, SprintlabError
from sprintlab.core.reading import printable
from sprintlab.motors import desaturate, shaft_torque, torque_limits
from sprintlab.motors.chart import SATURATED, JointDrive, envelope_names, joint_limits
from sprintlab.robots import RobotDescription

FloatArray = NDArray[np.float64]

_MARGIN = 1e-3  # share of the peak torque by which a sample may exceed an envelope: rounding
_NEAR = 0.01  # share of the peak torque within which a sample sits on the envelope
_NEEDED = ("joint_velocity", "joint_torque")
_CLOUD_FORMAT = 1
_CLOUD_FACTS = ("robot", "motor_model", "format")
_CLOUD_MARGIN = 5e-3  # share of the peak torque: clouds are kept in half precision
_CLOUD_SHAPES = {
    "time": "T",
    "joint_velocity": "Tnj",
    "joint_torque": "Tnj",
    "on_limit": "Tnj",
    "forward_speed": "Tn",
    "bus_voltage_factor": "Tn",
    "resistance_factor": "n",
    "motor_strength": "nj",
}


@dataclass(frozen=True, kw_only=True)
class OperatingPoints:
    """Samples of one or several joints, joint side.

    Attributes:
        speed: (n,) joint velocity [rad/s].
        torque: (n,) torque delivered to the joint [N m], saturation, gear and efficiency in.
    """

    speed: FloatArray
    torque: FloatArray

    def summary(self, drive: JointDrive) -> dict[str, Any]:
        """How near the samples come to the limits of ``drive``.

        ``at_limit`` is the share within 1 % of the peak torque of what the drive can deliver; ``beyond``
        holds, for each envelope, the share outside it.
        """
        margin = _MARGIN * drive.peak_torque
        beyond: dict[str, float] = {}
        for name in envelope_names():
            lower, upper = joint_limits(drive, self.speed, name)
            outside = (self.torque > upper + margin) | (self.torque < lower - margin)
            beyond[name] = float(np.mean(outside))
        return {
            "samples": len(self.speed),
            "speed_ratio": float(np.abs(self.speed).max()) / drive.no_load_speed,
            "torque_ratio": float(np.abs(self.torque).max()) / drive.peak_torque,
            "at_limit": self._at_limit(drive),
            "beyond": beyond,
        }

    def _at_limit(self, drive: JointDrive) -> float:
        lower, upper = joint_limits(drive, self.speed, SATURATED)
        reach = _NEAR * drive.peak_torque
        return float(np.mean((self.torque >= upper - reach) | (self.torque <= lower + reach)))


def load_operating_points(path: Path, joints: Sequence[int]) -> OperatingPoints:
    """Read the operating points of some joints from a recorded trajectory.

    Args:
        path: ``trajectory.npz`` or ``profile.npz`` of a race.
        joints: columns to take, together.

    Raises:
        SprintlabError: the file cannot be read, or holds no such arrays.
        InvalidValueError: no joint was chosen, or a value is not finite.
    """
    wanted = f"no recorded trajectory: it must be the trajectory.npz of a race, with {' and '.join(_NEEDED)}"
    arrays = _floats(path, read_arrays(path, _NEEDED, wanted=wanted), _NEEDED, wanted)
    shape = arrays[_NEEDED[0]].shape
    if len(shape) != 2 or any(array.shape != shape for array in arrays.values()) or not all(shape):
        raise SprintlabError(f"{path} is {wanted}")
    if joints and not 0 <= min(joints) <= max(joints) < shape[1]:
        raise SprintlabError(f"{path} holds {shape[1]} joints: it is another robot's")
    if not joints:
        raise InvalidValueError("joint", "", "choose a joint of the robot that ran: abad, hip or knee")
    speed, torque = (arrays[name][:, list(joints)].ravel() for name in _NEEDED)
    if not (np.isfinite(speed).all() and np.isfinite(torque).all()):
        raise InvalidValueError(str(path), "NaN", "the trajectory must be finite")
    return OperatingPoints(speed=speed, torque=torque)


def _floats(
    path: Path, found: dict[str, NDArray[Any]], names: Sequence[str], wanted: str
) -> dict[str, FloatArray]:
    """The named arrays as doubles; refuses where one is missing or holds texts."""
    if any(name not in found or found[name].dtype.kind not in "biuf" for name in names):
        raise SprintlabError(f"{path} is {wanted}")
    return {name: found[name].astype(float) for name in names}


@dataclass(frozen=True, kw_only=True)
class TrainingCloud:
    """What the motors of some robots did in the last seconds of their training: ``T`` moments, ``n`` robots.

    Attributes:
        robot: its name.
        motor_model: the motor of the training.
        time: of each moment ``(T,)`` [s].
        joint_velocity: ``(T, n, joints)`` [rad/s].
        joint_torque: delivered to the joint, saturation, gear and the robot's own strength in
            ``(T, n, joints)`` [N m].
        on_limit: whether the motor of the training gave less than was asked of it ``(T, n, joints)`` bool.
        forward_speed: ``(T, n)`` [m/s].
        bus_voltage_factor: bus voltage over the robot's nominal one ``(T, n)``.
        resistance_factor: stator resistance over the motor's nominal one ``(n,)``.
        motor_strength: torque over that of the nominal motor ``(n, joints)``.
    """

    robot: str
    motor_model: str
    time: FloatArray
    joint_velocity: FloatArray
    joint_torque: FloatArray
    on_limit: NDArray[np.bool_]
    forward_speed: FloatArray
    bus_voltage_factor: FloatArray
    resistance_factor: FloatArray
    motor_strength: FloatArray

    def motor_torque(self, robot: RobotDescription) -> FloatArray:
        """Motor torque before saturation ``(T, n, joints)`` [N m], as recorded runs have it."""
        shaft = shaft_torque(robot.gear, self.joint_torque / self.motor_strength, self.joint_velocity)
        return np.asarray(desaturate(robot.motors, shaft))

    def impossible(self, robot: RobotDescription) -> NDArray[np.bool_]:
        """Where the refined model, at the robot's own bus and resistance, forbids it ``(T, n, joints)``."""
        resistance = np.asarray(robot.motors.stator_resistance) * self.resistance_factor[:, None]
        motors = replace(robot.motors, stator_resistance=resistance)
        bus = robot.bus_voltage * self.bus_voltage_factor[..., None]
        lower, upper = torque_limits(motors, self.joint_velocity * np.asarray(robot.gear.ratio), bus)
        margin = _CLOUD_MARGIN * np.asarray(robot.motors.peak_torque)
        torque = self.motor_torque(robot)
        return np.asarray((torque > upper + margin) | (torque < lower - margin))


def load_training_cloud(path: Path) -> TrainingCloud:
    """Read the ``cloud.npz`` of a training run.

    Raises:
        SprintlabError: the file cannot be read, is no cloud, or is one of another format.
        InvalidValueError: a value is not finite.
    """
    needed = ", ".join((*_CLOUD_SHAPES, "robot", "motor_model", "format"))
    wanted = f"no cloud of a training, or is damaged: it must be the cloud.npz of a run, with {needed}"
    found = read_arrays(path, (*_CLOUD_SHAPES, *_CLOUD_FACTS), wanted=wanted)
    arrays = _floats(path, found, tuple(_CLOUD_SHAPES), wanted)
    if any(name not in found or found[name].size != 1 for name in _CLOUD_FACTS):
        raise SprintlabError(f"{path} is {wanted}")
    robot, motor_model, version = (found[name].item() for name in _CLOUD_FACTS)
    robot, motor_model = printable(robot, 80), printable(motor_model, 80)
    if version != _CLOUD_FORMAT:
        raise SprintlabError(f"{path} is a cloud of format {version}; this version reads {_CLOUD_FORMAT}")
    _check_cloud(path, arrays)
    on_limit = arrays.pop("on_limit") > 0.5
    return TrainingCloud(robot=robot, motor_model=motor_model, on_limit=on_limit, **arrays)


def _check_cloud(path: Path, arrays: dict[str, NDArray[Any]]) -> None:
    """Shapes that fit each other, and numbers."""
    shape = arrays["joint_velocity"].shape
    if len(shape) != 3 or 0 in shape:
        raise SprintlabError(f"{path} is no cloud of a training: joint_velocity has shape {shape}")
    sizes = dict(zip("Tnj", shape, strict=True))
    for name, axes in _CLOUD_SHAPES.items():
        if arrays[name].shape != tuple(sizes[axis] for axis in axes):
            raise SprintlabError(f"{path} is no cloud of a training: {name} has shape {arrays[name].shape}")
        if not np.isfinite(arrays[name]).all():
            raise InvalidValueError(str(path), "NaN", f"{name} must be finite")
