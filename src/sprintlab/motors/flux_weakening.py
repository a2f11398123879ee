"""Flux weakening: a negative d-axis current against the magnets, so that the bus suffices at higher speed.

For a surface machine (L_d = L_q = L) the voltage limit ``v_d^2 + v_q^2 <= V^2`` is a disk in the
(i_d, i_q) plane, with centre ``c = -w psi / Z^2 (w L, R)``, radius ``V / Z`` and ``Z^2 = R^2 + (w L)^2``;
the current limit is a disk of radius ``I`` about the origin. The admissible currents are what the two disks
share, and the torque ``1.5 N psi i_q`` is their height: ``docs/motors.md`` says which point gives most.
Between the limits the drive takes the least current for a torque.

Morimoto, Takeda, Hirasa, Taniguchi, "Expansion of operating limits for permanent magnet motor by current
vector control considering inverter capacity", IEEE Trans. Ind. Appl. 26(5), 1990; here with the resistance.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from sprintlab.motors.arrays import Array, as_arrays
from sprintlab.motors.parameters import PmsmParameters
from sprintlab.motors.voltage import phase_voltage_limit

_SMALLEST_SHARE = 1e-12
"""Share of the largest voltage at hand that keeps quotients finite at standstill."""
_SECTIONS = 64
"""Golden sections of the d-axis current; 0.618^64 is 4e-14."""
_SCANNED = 33
"""Points at which the d-axis current is tried before."""
_GOLDEN_SHARE = 0.5 * (math.sqrt(5.0) - 1.0)


class DqCurrents(NamedTuple):
    """Currents in the rotor's frame [A], amplitude invariant."""

    direct: Array
    """Along the magnets, i_d; negative weakens them."""
    quadrature: Array
    """Across the magnets, i_q; makes the torque."""


class _CurrentPlane(NamedTuple):
    """The two disks of one operating point, all arrays of one namespace ``xp``."""

    xp: Any
    torque_constant: Array  # 1.5 N psi [N m/A]
    current_limit: Array  # radius of the current disk [A]
    radius: Array  # radius of the voltage disk [A]
    distance: Array  # distance of the voltage disk's centre from the origin [A]
    direct: Array  # d-axis component of the unit vector toward the centre, not positive
    quadrature: Array  # its q-axis component; has the opposite sign of the speed
    chord: Array  # distance of the crossings' chord from the origin along that vector [A]
    empty: Array  # where the disks share nothing


def flux_weakening_limits(motor: PmsmParameters, speed: Array, bus_voltage: Array) -> tuple[Array, Array]:
    """Least and greatest torque with flux weakening; see ``torque_limits``, which calls this.

    Above the speed where the disks part, the interval reaches from the torque of the current that violates
    the voltage limit least, ``-1.5 N psi I R / Z``, to zero: no drive.
    """
    plane = _current_plane(motor, speed, bus_voltage)
    xp = plane.xp
    upper = _greatest_quadrature(plane, plane.quadrature)
    lower = -_greatest_quadrature(plane, -plane.quadrature)  # the mirrored plane's greatest
    nothing = xp.zeros_like(upper)
    upper = xp.where(plane.empty, xp.maximum(upper, nothing), upper)
    lower = xp.where(plane.empty, xp.minimum(lower, nothing), xp.minimum(lower, upper))
    return lower * plane.torque_constant, upper * plane.torque_constant


def dq_currents(motor: PmsmParameters, torque: Array, speed: Array, bus_voltage: Array) -> DqCurrents:
    """Currents with the least copper loss that give a torque, clipped to ``flux_weakening_limits``.

    Never NaN. Where no current satisfies the voltage limit, the one that is nearest to it.
    """
    lower, upper = flux_weakening_limits(motor, speed, bus_voltage)
    xp, (torque, constant, _) = as_arrays(torque, motor.torque_constant, upper)
    torque = xp.minimum(xp.maximum(torque, lower), upper)
    return DqCurrents(weakening_current(motor, torque, speed, bus_voltage), torque / constant)


def weakening_current(motor: PmsmParameters, torque: Array, speed: Array, bus_voltage: Array) -> Array:
    """The d-axis current nearest to zero [A] for a torque that lies within ``flux_weakening_limits``.

    Not positive, never NaN.
    """
    plane = _current_plane(motor, speed, bus_voltage)
    _, (torque, constant) = as_arrays(torque, plane.torque_constant)
    return _least_direct(plane, torque / constant)


def flux_weakening_infeasible(motor: PmsmParameters, speed: Array, bus_voltage: Array) -> Array:
    """Where no current within the current limit satisfies the voltage limit: ``w psi > V + I Z``."""
    return _current_plane(motor, speed, bus_voltage).empty


def flux_weakening_critical_speed(motor: PmsmParameters, torque: Array, bus_voltage: Array) -> Array:
    """Highest speed at which a torque fits with flux weakening; see ``critical_speed``, which calls this.

    For one current the highest speed is a root of a quadratic. Over the d-axis current, which the torque
    leaves free between the current limit and zero, that speed has one maximum (speeds above a given one are
    reached on a chord of the voltage disk), beside which it may be zero throughout: a braking torque that no
    voltage could hold at low speed. A coarse scan brackets the maximum, golden sections find it.

    Returns:
        Mechanical speed [rad/s], not negative. Infinity for no torque where the current limit reaches the
        point to which the voltage disk shrinks (``I >= psi / L``) and the voltage holds it there.
    """
    xp, (torque, *values) = _with_motor(torque, motor, bus_voltage)
    pole_pairs, resistance, inductance, flux, peak, voltage = values
    constant = 1.5 * pole_pairs * flux
    quadrature, limit = torque / constant, peak / constant

    def highest(direct: Array) -> Array:
        linkage = (inductance * quadrature) ** 2 + (flux + inductance * direct) ** 2
        linkage = linkage + (_SMALLEST_SHARE * flux) ** 2
        drop = resistance * quadrature * flux
        spare = voltage**2 - resistance**2 * (direct**2 + quadrature**2)
        discriminant = drop**2 + linkage * spare
        nothing = xp.zeros_like(discriminant)
        root = (xp.sqrt(xp.maximum(discriminant, nothing)) - drop) / linkage
        # Below zero where no speed fits: how far from it, so that the search climbs there too.
        return xp.where(discriminant < 0, discriminant / linkage, xp.maximum(root, nothing))

    none = 0.0 * (quadrature + limit + voltage + resistance + inductance)
    most = -xp.sqrt(xp.maximum((limit - quadrature) * (limit + quadrature), none))
    low, high = _around_highest(xp, highest, most, none)
    for _ in range(_SECTIONS):
        step = _GOLDEN_SHARE * (high - low)
        left, right = high - step, low + step
        upward = highest(right) >= highest(left)
        low, high = xp.where(upward, left, low), xp.where(upward, high, right)
    speed = xp.maximum(xp.maximum(highest(high), highest(none)), none) / pole_pairs
    endless = (limit * inductance >= flux) & (voltage * inductance > resistance * flux) & (torque == 0)
    return xp.where(endless, xp.zeros_like(speed) + float("inf"), speed)


def _around_highest(
    xp: Any, function: Callable[[Array], Array], low: Array, high: Array
) -> tuple[Array, Array]:
    """The neighbours of the best of ``_SCANNED`` evenly spaced points between ``low`` and ``high``."""
    step = (high - low) / (_SCANNED - 1)
    best, value = high, function(high)
    for index in range(_SCANNED - 1):
        point = low + index * step
        found = function(point)
        better = found > value
        best, value = xp.where(better, point, best), xp.where(better, found, value)
    return xp.maximum(best - step, low), xp.minimum(best + step, high)


def _with_motor(value: Array, motor: PmsmParameters, bus_voltage: Array) -> tuple[Any, list[Array]]:
    """``value``, the motor's numbers but its inertia and saturation, and the voltage limit in one library."""
    windings = (motor.stator_resistance, motor.q_axis_inductance, motor.flux_linkage, motor.peak_torque)
    return as_arrays(value, motor.pole_pairs, *windings, phase_voltage_limit(bus_voltage))


def _current_plane(motor: PmsmParameters, speed: Array, bus_voltage: Array) -> _CurrentPlane:
    xp, (speed, *values) = _with_motor(speed, motor, bus_voltage)
    pole_pairs, resistance, inductance, flux, peak, voltage = values
    constant = 1.5 * pole_pairs * flux
    limit = peak / constant
    electrical_speed = pole_pairs * speed
    reactance = electrical_speed * inductance
    impedance = xp.sqrt(resistance**2 + reactance**2)
    emf = xp.abs(electrical_speed) * flux
    reach = limit * impedance
    # From the law of cosines; sums and differences keep digits in float32 that squares would lose.
    chord = (reach**2 + (emf - voltage) * (emf + voltage)) / (
        2.0 * impedance * (emf + _SMALLEST_SHARE * (reach + voltage))
    )
    against = xp.where(speed < 0, resistance, -resistance)
    return _CurrentPlane(
        xp=xp,
        torque_constant=constant,
        current_limit=limit,
        radius=voltage / impedance,
        distance=emf / impedance,
        direct=-xp.abs(reactance) / impedance,
        quadrature=against / impedance,
        chord=xp.minimum(xp.maximum(chord, -limit), limit),
        empty=emf > voltage + reach,
    )


def _greatest_quadrature(plane: _CurrentPlane, toward: Array) -> Array:
    """Greatest i_q that both disks hold; ``toward``: the q component of the unit vector to the centre."""
    xp, limit, radius = plane.xp, plane.current_limit, plane.radius
    center_direct, center_quadrature = plane.distance * plane.direct, plane.distance * toward
    half_chord = xp.sqrt(xp.maximum((limit - plane.chord) * (limit + plane.chord), 0.0 * limit))
    crossing = plane.chord * toward - half_chord * plane.direct
    top = center_quadrature + radius
    voltage_decides = center_direct**2 + top**2 <= limit**2
    current_decides = center_direct**2 + (limit - center_quadrature) ** 2 <= radius**2
    greatest = xp.where(voltage_decides, top, crossing)
    return xp.where(current_decides, limit, greatest)


def _least_direct(plane: _CurrentPlane, quadrature: Array) -> Array:
    """The d-axis current nearest to zero that the voltage disk has at ``quadrature``."""
    xp, limit = plane.xp, plane.current_limit
    above = quadrature - plane.distance * plane.quadrature
    squared = (plane.radius - above) * (plane.radius + above)
    nothing = xp.zeros_like(squared)
    chord_end = plane.distance * plane.direct + xp.sqrt(xp.maximum(squared, nothing))
    lowest = -xp.sqrt(xp.maximum((limit - quadrature) * (limit + quadrature), nothing))
    return xp.maximum(xp.minimum(chord_end, nothing), lowest)
