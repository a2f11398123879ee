"""The torque-speed envelope of a motor behind an inverter with a limited voltage.

With i_d = 0, the electrical speed ``w = N omega`` and the torque ``1.5 N psi i``, the phase voltages are
``v_d = -w L i`` and ``v_q = R i + w psi``; the inverter demands ``v_d^2 + v_q^2 <= V^2``. For a given
speed this is one interval of the current, for a given current one of the speed.

The models differ in what they keep: ``refined`` all of it, ``simplified-dc`` drops ``v_d`` (the usual
straight torque-speed line; the same as L = 0), ``square`` drops the voltage limit altogether.
``flux-weakening`` is the refined law with a d-axis current where that helps: see ``flux_weakening``.
"""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

from sprintlab.core.checks import check_choice
from sprintlab.motors.arrays import Array, as_arrays
from sprintlab.motors.flux_weakening import (
    flux_weakening_critical_speed,
    flux_weakening_infeasible,
    flux_weakening_limits,
)
from sprintlab.motors.parameters import PmsmParameters
from sprintlab.motors.voltage import phase_voltage_limit

MotorModel = Literal["refined", "simplified-dc", "square", "flux-weakening"]
MOTOR_MODELS: tuple[MotorModel, ...] = ("refined", "simplified-dc", "square", "flux-weakening")
"""The envelopes: the paper's three, by what they know of the inverter's voltage, and flux weakening."""


class _VoltageInterval(NamedTuple):
    """The torques between which the voltage suffices: ``middle ± half_width``, real if the excess is <= 0."""

    middle: Array
    half_width: Array
    excess: Array


def torque_limits(
    motor: PmsmParameters, speed: Array, bus_voltage: Array, model: MotorModel = "refined"
) -> tuple[Array, Array]:
    """Least and greatest torque that the motor can give at a mechanical speed [rad/s] on a DC bus [V].

    The whole admissible interval in all four quadrants: at positive speed ``upper`` bounds driving and
    ``lower`` braking; the resistive drop helps braking, so the interval is not symmetric. Above the
    no-load speed ``upper`` is negative: the back-EMF drives a braking current through the inverter's diodes,
    whatever the controller asks for. Above the speed where no current satisfies the voltage limit, the drive
    has no choice left: both ends are the braking torque that violates it least,
    ``-1.5 N psi R w psi / Z^2``, which continues the interval without a jump. With flux weakening, where that
    speed is far higher, it reaches from there to zero.

    Returns:
        ``(lower, upper)`` [N m], ``lower <= upper``, never NaN, within ``±peak_torque``, before saturation.
    """
    check_choice("model", model, MOTOR_MODELS)
    if model == "square":
        xp, (peak, still) = as_arrays(motor.peak_torque, speed)
        upper = peak + 0.0 * still
        return -upper, upper
    if model == "flux-weakening":
        return flux_weakening_limits(motor, speed, bus_voltage)
    xp, interval, peak = _voltage_interval(motor, speed, bus_voltage, model)
    lower, upper = interval.middle - interval.half_width, interval.middle + interval.half_width
    return xp.minimum(xp.maximum(lower, -peak), peak), xp.minimum(xp.maximum(upper, -peak), peak)


def voltage_infeasible(
    motor: PmsmParameters, speed: Array, bus_voltage: Array, model: MotorModel = "refined"
) -> Array:
    """Where no torque within ``±peak_torque`` satisfies the voltage limit: over-speed, to be counted.

    Returns:
        Truth values; all false under ``"square"``, which knows no voltage limit.
    """
    check_choice("model", model, MOTOR_MODELS)
    if model == "flux-weakening":
        return flux_weakening_infeasible(motor, speed, bus_voltage)
    xp, interval, peak = _voltage_interval(motor, speed, bus_voltage, model)
    if model == "square":
        return xp.zeros_like(interval.excess > 0)
    nearest_to_zero = xp.abs(interval.middle) - interval.half_width
    return (interval.excess > 0) | (nearest_to_zero > peak)


def critical_speed(
    motor: PmsmParameters, torque: Array, bus_voltage: Array, model: MotorModel = "refined"
) -> Array:
    """Highest speed at which the voltage suffices for a torque (the paper's omega_c at ``peak_torque``).

    The greater root of ``(L^2 i^2 + psi^2) w^2 + 2 R i psi w + R^2 i^2 = V^2``.

    A negative torque brakes. The current limit is applied only to the d-axis current of flux weakening.

    Returns:
        [rad/s], not negative; 0 where the torque fits at no positive speed, infinity under ``"square"``.
    """
    check_choice("model", model, MOTOR_MODELS)
    if model == "flux-weakening":
        return flux_weakening_critical_speed(motor, torque, bus_voltage)
    xp, (torque, pole_pairs, resistance, inductance, flux, voltage) = as_arrays(
        torque,
        motor.pole_pairs,
        motor.stator_resistance,
        _inductance(motor, model),
        motor.flux_linkage,
        phase_voltage_limit(bus_voltage),
    )
    current = torque / (1.5 * pole_pairs * flux)
    if model == "square":
        return xp.full_like(current + voltage, float("inf"))
    squared_flux = (inductance * current) ** 2 + flux**2
    discriminant = squared_flux * voltage**2 - (inductance * resistance * current**2) ** 2
    root = xp.sqrt(xp.maximum(discriminant, xp.zeros_like(discriminant))) - resistance * current * flux
    speed = root / squared_flux / pole_pairs
    return xp.where((discriminant < 0) | (speed < 0), xp.zeros_like(speed), speed)


def no_load_speed(motor: PmsmParameters, bus_voltage: Array) -> Array:
    """Speed at which the back-EMF alone takes the whole voltage, ``V / (N psi)`` [rad/s]."""
    _, (voltage, pole_pairs, flux) = as_arrays(
        phase_voltage_limit(bus_voltage), motor.pole_pairs, motor.flux_linkage
    )
    return voltage / (pole_pairs * flux)


def _inductance(motor: PmsmParameters, model: MotorModel) -> Array:
    """Inductance in a model [H]; raises ``InvalidValueError`` for a model without a law here."""
    if model == "refined":
        return motor.q_axis_inductance
    check_choice("model", model, ("refined", "simplified-dc", "square"))
    return 0.0


def _voltage_interval(
    motor: PmsmParameters, speed: Array, bus_voltage: Array, model: MotorModel
) -> tuple[Any, _VoltageInterval, Array]:
    """Solve the voltage limit for the torque; where it has no solution the half width is zero."""
    xp, (speed, pole_pairs, resistance, inductance, flux, peak, voltage) = as_arrays(
        speed,
        motor.pole_pairs,
        motor.stator_resistance,
        _inductance(motor, model),
        motor.flux_linkage,
        motor.peak_torque,
        phase_voltage_limit(bus_voltage),
    )
    electrical_speed = pole_pairs * speed
    reactance = electrical_speed * inductance
    impedance = xp.sqrt(resistance**2 + reactance**2)
    # Z^2 V^2 - w^4 L^2 psi^2 as a product: a difference of fourth powers would lose digits in float32.
    voltage_across = impedance * voltage
    reactive_emf = xp.abs(electrical_speed * reactance * flux)
    slack = voltage_across - reactive_emf
    root = xp.sqrt(xp.maximum(slack, xp.zeros_like(flux)) * (voltage_across + reactive_emf))
    torque_per_ohm_volt = 1.5 * pole_pairs * flux / impedance**2
    middle = -torque_per_ohm_volt * resistance * electrical_speed * flux
    return xp, _VoltageInterval(middle, torque_per_ohm_volt * root, -slack), peak
