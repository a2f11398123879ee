"""The drive of one joint: from the torque that a controller wants to the torque that the joint gets."""

from __future__ import annotations

from typing import NamedTuple

from sprintlab.motors.arrays import Array, as_arrays
from sprintlab.motors.envelope import MotorModel, torque_limits
from sprintlab.motors.flux_weakening import weakening_current
from sprintlab.motors.gear import Gear, joint_torque, motor_speed
from sprintlab.motors.parameters import PmsmParameters
from sprintlab.motors.saturation import saturate


class DriveOutput(NamedTuple):
    """What a drive gives; all in the broadcast shape of the inputs."""

    torque: Array  # Torque on the joint [N m]
    motor_torque: Array
    """Torque that the motor's current stands for [N m], motor side, after the clip, before saturation."""
    lower: Array  # Least admissible ``motor_torque`` [N m]
    upper: Array  # Greatest admissible ``motor_torque`` [N m]
    direct_current: Array = 0.0  # i_d of flux weakening [A]; 0 in the other models


def drive_torque(
    motor: PmsmParameters,
    gear: Gear,
    desired_joint_torque: Array,
    joint_velocity: Array,
    bus_voltage: Array,
    model: MotorModel = "refined",
) -> DriveOutput:
    """Torque on the joint when a controller wants ``desired_joint_torque``.

    Gear down, clip to ``torque_limits``, ``saturate``, gear up with losses in the direction of power: like
    firmware that turns torque into current by the nominal torque constant. Nothing here waits for a device.

    Torque [N m] and velocity [rad/s] may have the shape ``(n, 12)`` where motors have ``(12,)``.
    """
    xp, (desired, ratio) = as_arrays(desired_joint_torque, gear.ratio)
    speed = motor_speed(gear, joint_velocity)
    lower, upper = torque_limits(motor, speed, bus_voltage, model)
    motor_torque = xp.minimum(xp.maximum(desired / ratio, lower), upper)
    torque = joint_torque(gear, saturate(motor, motor_torque), joint_velocity)
    if model == "flux-weakening":
        direct = weakening_current(motor, motor_torque, speed, bus_voltage)
    else:
        direct = xp.zeros_like(motor_torque)
    return DriveOutput(torque, motor_torque, lower, upper, direct)
