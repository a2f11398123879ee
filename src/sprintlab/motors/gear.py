"""A reduction gear between motor and joint."""

from __future__ import annotations

from dataclasses import dataclass

from sprintlab.core.checks import check_range
from sprintlab.motors.arrays import Array, as_arrays


@dataclass(frozen=True, kw_only=True)
class Gear:
    """A reduction gear; each field a number or an array with one gear an element.

    Raises:
        InvalidValueError: a ratio outside [1, 500] or an efficiency outside [0.01, 1].
    """

    ratio: Array
    """Motor speed over joint speed G [-]."""
    efficiency: Array
    """Joint torque over G times the motor torque [-]."""

    def __post_init__(self) -> None:
        """Refuse gears that cannot be built."""
        check_range("ratio", self.ratio, 1.0, 500.0)
        check_range("efficiency", self.efficiency, 0.01, 1.0)


def motor_speed(gear: Gear, joint_velocity: Array) -> Array:
    """Speed of the motor's shaft [rad/s] for a joint velocity [rad/s], broadcast."""
    _, (velocity, ratio) = as_arrays(joint_velocity, gear.ratio)
    return velocity * ratio


def joint_torque(gear: Gear, motor_torque: Array) -> Array:
    """Torque on the joint [N m] for a torque on the motor's shaft [N m], broadcast."""
    _, (torque, ratio, efficiency) = as_arrays(motor_torque, gear.ratio, gear.efficiency)
    return torque * ratio * efficiency


def reflected_inertia(gear: Gear, rotor_inertia: Array) -> Array:
    """Inertia of the rotor as the joint feels it, ``G^2 J`` [kg m^2], for ``rotor_inertia`` J [kg m^2]."""
    _, (inertia, ratio) = as_arrays(rotor_inertia, gear.ratio)
    return inertia * ratio**2
