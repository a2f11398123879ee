"""A reduction gear between motor and joint."""

from __future__ import annotations

from dataclasses import dataclass

from sprintlab.core.checks import check_range
from sprintlab.motors.arrays import Array, as_arrays

TURNING_SPEED = 1.0
"""Joint speed over which a gear's loss turns its direction [rad/s]: as little as a 1 kHz loop carries."""


@dataclass(frozen=True, kw_only=True)
class Gear:
    """A reduction gear; each field a number or an array with one gear an element."""

    ratio: Array
    """Motor speed over joint speed G [-]."""
    efficiency: Array
    """Power that comes out over power that goes in, in either direction [-]."""

    def __post_init__(self) -> None:
        check_range("ratio", self.ratio, 1.0, 500.0)
        check_range("efficiency", self.efficiency, 0.01, 1.0)


def motor_speed(gear: Gear, joint_velocity: Array) -> Array:
    """Speed of the motor's shaft [rad/s] for a joint velocity [rad/s], broadcast."""
    _, (velocity, ratio) = as_arrays(joint_velocity, gear.ratio)
    return velocity * ratio


def joint_torque(gear: Gear, motor_torque: Array, joint_velocity: Array | None = None) -> Array:
    """Torque on the joint for a torque on the motor's shaft; the gear takes in either direction of power.

    Driving, the joint gets ``G tau eta``; braking, the motor sees the joint torque times ``eta``, and the
    joint feels ``G tau / eta``. In between, over about ``TURNING_SPEED``, ``eta`` changes its exponent
    smoothly from 1 to -1, so that the loss is friction: never negative, and none at rest. The torque of the
    motor is after saturation; without a ``joint_velocity`` [rad/s] the motor drives.
    """
    _, (torque, ratio) = as_arrays(motor_torque, gear.ratio)
    return torque * ratio * _passed_on(gear, torque, joint_velocity)


def shaft_torque(gear: Gear, torque: Array, joint_velocity: Array | None = None) -> Array:
    """Torque on the motor's shaft [N m] behind a torque on the joint [N m]: inverse of ``joint_torque``."""
    _, (torque, ratio) = as_arrays(torque, gear.ratio)
    return torque / (ratio * _passed_on(gear, torque, joint_velocity))


def _passed_on(gear: Gear, torque: Array, joint_velocity: Array | None) -> Array:
    """Joint torque over ratio times motor torque: from ``1 / efficiency``, braking, to ``efficiency``."""
    if joint_velocity is None:
        _, (_, efficiency) = as_arrays(torque, gear.efficiency)
        return efficiency
    xp, (torque, velocity, efficiency) = as_arrays(torque, joint_velocity, gear.efficiency)
    return efficiency ** (xp.sign(torque) * xp.tanh(velocity / TURNING_SPEED))


def reflected_inertia(gear: Gear, rotor_inertia: Array) -> Array:
    """Inertia of the rotor as the joint feels it, ``G^2 J`` [kg m^2], for ``rotor_inertia`` J [kg m^2]."""
    _, (inertia, ratio) = as_arrays(rotor_inertia, gear.ratio)
    return inertia * ratio**2
