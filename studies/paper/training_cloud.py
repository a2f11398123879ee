"""What the motors of a training did: the cloud.npz that a run leaves in its folder."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sprintlab.core.archives import named_floats, read_arrays
from sprintlab.core.errors import InvalidValueError, SprintlabError, printable
from sprintlab.motors import MOTOR_MODELS, desaturate, shaft_torque, torque_limits
from sprintlab.robots import RobotDescription

FloatArray = NDArray[np.float64]

_FORMAT = 1
_FACTS = ("robot", "motor_model", "format")
_JOINTS = 12
_MOST_NUMBERS = 1_000_000  # in an array: a run keeps 40 000, and each is drawn and asked for its limits
_LARGEST_CLOUD = 32 << 20  # bytes of all arrays, each number of which becomes one of 8; a run has 0.2 MB
_MARGIN = 5e-3  # share of the peak torque: clouds are kept in half precision
_LARGEST = 1e12
_FACTORS = ("bus_voltage_factor", "resistance_factor", "motor_strength")
_SHAPES = {
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
        margin = _MARGIN * np.asarray(robot.motors.peak_torque)
        torque = self.motor_torque(robot)
        return np.asarray((torque > upper + margin) | (torque < lower - margin))


def load_training_cloud(path: Path) -> TrainingCloud:
    """Read the ``cloud.npz`` of a training run.

    Raises:
        SprintlabError: the file cannot be read, is no cloud of a robot with twelve joints and a known motor,
            is one of another format, or holds more or larger numbers than a training leaves.
        InvalidValueError: a value is not finite.
    """
    needed = ", ".join((*_SHAPES, "robot", "motor_model", "format"))
    wanted = f"no cloud of a training, or is damaged: it must be the cloud.npz of a run, with {needed}"
    found = read_arrays(path, (*_SHAPES, *_FACTS), wanted=wanted, limit=_LARGEST_CLOUD)
    arrays = named_floats(path, found, tuple(_SHAPES), wanted)
    if any(name not in found or found[name].size != 1 for name in _FACTS):
        raise SprintlabError(f"{path} is {wanted}")
    robot, motor_model, version = (found[name].item() for name in _FACTS)
    robot, motor_model = printable(robot, 80), printable(motor_model, 80)
    if version != _FORMAT:
        raise SprintlabError(f"{path} is a cloud of format {version}; this version reads {_FORMAT}")
    if motor_model not in MOTOR_MODELS:
        raise SprintlabError(f"{path} is {wanted}, of one of the motors {', '.join(MOTOR_MODELS)}")
    _check_cloud(path, arrays)
    on_limit = arrays.pop("on_limit") > 0.5
    return TrainingCloud(robot=robot, motor_model=motor_model, on_limit=on_limit, **arrays)


def _check_cloud(path: Path, arrays: dict[str, NDArray[Any]]) -> None:
    """Shapes that fit each other, and numbers."""
    shape = arrays["joint_velocity"].shape
    if len(shape) != 3 or 0 in shape or shape[-1] != _JOINTS:
        raise SprintlabError(f"{path} is no cloud of a training: joint_velocity has shape {shape}")
    if arrays["joint_velocity"].size > _MOST_NUMBERS:
        raise SprintlabError(f"{path} is larger than a cloud of a training: joint_velocity has shape {shape}")
    sizes = dict(zip("Tnj", shape, strict=True))
    for name, axes in _SHAPES.items():
        if arrays[name].shape != tuple(sizes[axis] for axis in axes):
            raise SprintlabError(f"{path} is no cloud of a training: {name} has shape {arrays[name].shape}")
        if not np.isfinite(arrays[name]).all():
            raise InvalidValueError(str(path), "NaN", f"{name} must be finite")
        largest = float(np.abs(arrays[name]).max())
        if largest > _LARGEST or (name in _FACTORS and not arrays[name].min() > 0.0):
            raise SprintlabError(f"{path} is no cloud of a training: {name} is beyond what a robot has")
