"""Electrical power of a motor."""

from __future__ import annotations

from sprintlab.motors.arrays import Array, as_arrays
from sprintlab.motors.parameters import PmsmParameters
from sprintlab.motors.saturation import saturate


def copper_loss(motor: PmsmParameters, motor_torque: Array, direct_current: Array = 0.0) -> Array:
    """Heat in the windings, ``1.5 R (i_d^2 + i_q^2)`` [W], for an i_d ``direct_current`` [A]."""
    _, (torque, direct, resistance, constant) = as_arrays(
        motor_torque, direct_current, motor.stator_resistance, motor.torque_constant
    )
    return 1.5 * resistance * ((torque / constant) ** 2 + direct**2)


def electrical_power(
    motor: PmsmParameters, motor_torque: Array, speed: Array, direct_current: Array = 0.0
) -> Array:
    """Power drawn from the bus [W]; negative when it feeds back.

    Shaft power and copper loss, ``tau_out omega + 1.5 R (i_d^2 + i_q^2)``: the reactances exchange power
    between the axes only. A saturated motor has less torque for a current and, by the same flux, less
    back-EMF for a speed: it makes no energy and takes none, driving or braking.
    """
    _, (torque, speed) = as_arrays(motor_torque, speed)
    return saturate(motor, torque) * speed + copper_loss(motor, torque, direct_current)
