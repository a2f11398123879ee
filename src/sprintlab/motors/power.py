"""Electrical power of a motor with i_d = 0."""

from __future__ import annotations

from sprintlab.motors.arrays import Array, as_arrays
from sprintlab.motors.parameters import PmsmParameters


def copper_loss(motor: PmsmParameters, motor_torque: Array) -> Array:
    """Heat in the windings, ``1.5 R i_q^2`` [W].

    Args:
        motor: parameters, numbers or arrays that broadcast with ``motor_torque``.
        motor_torque: torque that the current stands for, before saturation [N m].
    """
    _, (torque, resistance, constant) = as_arrays(
        motor_torque, motor.stator_resistance, motor.torque_constant
    )
    return 1.5 * resistance * (torque / constant) ** 2


def electrical_power(motor: PmsmParameters, motor_torque: Array, speed: Array) -> Array:
    """Power drawn from the bus, ``1.5 v_q i_q = tau omega + 1.5 R i_q^2`` [W]; negative when it feeds back.

    Saturation takes torque from the shaft, not from the balance: what it takes is counted as drawn.

    Args:
        motor: parameters, numbers or arrays that broadcast with ``motor_torque``.
        motor_torque: torque that the current stands for, before saturation [N m].
        speed: mechanical motor speed [rad/s], broadcasts with ``motor_torque``.
    """
    _, (torque, speed) = as_arrays(motor_torque, speed)
    return torque * speed + copper_loss(motor, torque)
