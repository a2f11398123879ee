"""A battery behind the bus that all joints share: the more they draw, the less voltage each of them has.

An open-circuit voltage ``E`` that falls with the charge, behind an internal resistance ``R``. A load that
draws the power ``P`` at the terminal voltage ``V`` satisfies ``V^2 - E V + R P = 0``; the greater root is the
stable one. The power in turn depends on the voltage wherever a motor is on its envelope, so that voltage and
torque are found together: ``shared_bus_voltage``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from sprintlab.core.checks import check_range
from sprintlab.core.errors import InvalidValueError
from sprintlab.motors.arrays import Array, Floats, as_arrays, as_values

SECONDS_PER_HOUR = 3600.0
_SOLVER_STEPS = 34  # so many bisections narrow 1.7 MV, more than any pack's bracket, to the tolerance
_SOLVER_TOLERANCE = 1e-4  # [V]
_LEAST_SLOPE = 0.1  # the residual's slope is 1 where no motor is on its envelope, and more where one drives


@dataclass(frozen=True, kw_only=True)
class Battery:
    """A pack of equal cells; plain numbers, one pack for the whole robot.

    The defaults are an assumption, not a robot's: 14 cells of the 21700 size in series, three in parallel
    (58.8 V full, the nearest below a 60 V bus), each with 16 milliohm and 4.2 A h.
    """

    series_cells: int = 14
    """Cells in series [-]."""
    charge_table: tuple[float, ...] = (0.0, 0.05, 0.1, 0.2, 0.4, 0.6, 0.8, 1.0)
    """States of charge at which ``voltage_table`` holds [-], rising from 0 to 1."""
    voltage_table: tuple[float, ...] = (2.80, 3.15, 3.30, 3.45, 3.62, 3.80, 4.00, 4.20)
    """Open-circuit voltage of one cell at those states [V], rising; linear between them."""
    internal_resistance: float = 0.075
    """Resistance of the whole pack [ohm]."""
    capacity: float = 12.6
    """Charge of the whole full pack [A h]."""
    regeneration_limit: float = 25.0
    """Greatest current that the pack takes back [A]; a brake resistor burns what comes beyond. 0: none."""

    def __post_init__(self) -> None:
        check_range("battery.series_cells", self.series_cells, 1, 500)
        check_range("battery.internal_resistance", self.internal_resistance, 0.0, 10.0, "ohm")
        check_range("battery.capacity", self.capacity, 1e-3, 1e6, "A h")
        check_range("battery.regeneration_limit", self.regeneration_limit, 0.0, 1e5, "A")
        self._check_tables()

    def _check_tables(self) -> None:
        charge, voltage = self.charge_table, self.voltage_table
        for name, table, low, high in (("charge", charge, 0.0, 1.0), ("voltage", voltage, 1e-3, 1e3)):
            for value in table:
                check_range(f"battery.{name}_table", value, low, high)
            if any(later <= earlier for earlier, later in pairwise(table)):
                raise InvalidValueError(f"battery.{name}_table", table, "must rise from number to number")
        if len(charge) != len(voltage):
            raise InvalidValueError("battery.voltage_table", voltage, "give one voltage for each charge")
        if (*charge[:1], *charge[-1:]) != (0.0, 1.0):
            raise InvalidValueError("battery.charge_table", charge, "must reach from 0 to 1")


def open_circuit_voltage(battery: Battery, state_of_charge: Array) -> Array:
    """Voltage of the pack without load [V] at a state of charge [-]; beyond 0 and 1 as at the ends."""
    xp, (charge,) = as_values(state_of_charge)
    voltage = xp.zeros_like(charge) + battery.voltage_table[0]
    steps = zip(pairwise(battery.charge_table), pairwise(battery.voltage_table), strict=True)
    for (start, end), (low, high) in steps:
        passed = xp.minimum(xp.maximum(charge - start, 0.0 * charge), 0.0 * charge + (end - start))
        voltage = voltage + passed * ((high - low) / (end - start))
    return battery.series_cells * voltage


def loaded_voltage(battery: Battery, state_of_charge: Array, power: Array) -> Array:
    """Voltage of the bus while all joints together draw a power [W], ``(E + sqrt(E^2 - 4 R P)) / 2`` [V].

    More power than ``E^2 / 4 R``, the most that the pack can give, leaves ``E / 2``; feedback, which is
    negative, leaves at most ``E + R x regeneration_limit``.
    """
    return _under_load(battery, open_circuit_voltage(battery, state_of_charge), power)


def _under_load(battery: Battery, source: Array, power: Array) -> Array:
    """``loaded_voltage`` of a pack whose open-circuit voltage is known."""
    xp, (power, source) = as_values(power, source)
    squared = source * source - 4.0 * battery.internal_resistance * power
    voltage = 0.5 * (source + xp.sqrt(xp.maximum(squared, xp.zeros_like(squared))))
    return xp.minimum(voltage, source + battery.internal_resistance * battery.regeneration_limit)


def shared_bus_voltage(
    battery: Battery,
    state_of_charge: Array,
    power_at: Callable[[Array], Array],
    guess: Array | None = None,
) -> Array:
    """The voltage at which the joints draw just the power that lowers the bus to it [V].

    A root of ``V - loaded_voltage(P(V))`` between the voltages that ``loaded_voltage`` can give, found by
    secants. Each is held so near the middle of its bracket that the last step leaves 0.1 mV of it, however
    the power depends on the voltage (the projection of the ITP method: Oliveira and Takahashi, ACM Trans.
    Math. Softw. 47, 2020); that moves only those still looking after some fifteen steps. A voltage whose
    residual is below 0.1 mV stays. Tensors take a fixed number of steps and never make the host wait; NumPy
    stops when all stay, most often after three or four.

    Args:
        battery: the pack.
        state_of_charge: [-], one value per pack, e.g. of shape ``(n,)``.
        power_at: power of all joints together [W] ``(n,)`` at a bus voltage [V] ``(n,)``.
        guess: where to begin [V], e.g. the voltage a moment ago; the highest possible when left out.
    """
    source = open_circuit_voltage(battery, state_of_charge)
    xp, (source, first) = as_values(source, source if guess is None else guess)

    def residual(voltage: Array) -> Array:
        power = power_at(voltage)
        return voltage - _under_load(battery, source, float(power) if xp is Floats else power)

    low, high = 0.5 * source, source + battery.internal_resistance * battery.regeneration_limit
    older = high if guess is None else xp.minimum(xp.maximum(first, low), high)
    older_error = residual(older)
    voltage, room = older - older_error, _SOLVER_TOLERANCE * 2.0**_SOLVER_STEPS
    for _ in range(_SOLVER_STEPS):
        error = residual(voltage)
        found = xp.abs(error) < _SOLVER_TOLERANCE
        if found is True or (xp is np and bool(found.all())):
            break
        low, high = xp.where(error > 0, low, voltage), xp.where(error > 0, voltage, high)
        room *= 0.5
        following = _held(xp, _secant(xp, voltage, error, older, older_error), low, high, room)
        older, older_error = voltage, error
        voltage = xp.where(found, voltage, following)
    return voltage


def battery_current(battery: Battery, voltage: Array, power: Array) -> Array:
    """Current out of the pack [A] at a voltage [V] and power [W]; into it at most ``regeneration_limit``."""
    xp, (voltage, power) = as_arrays(voltage, power)
    current = power / voltage
    return xp.maximum(current, xp.zeros_like(current) - battery.regeneration_limit)


def discharged(battery: Battery, state_of_charge: Array, current: Array, duration: float) -> Array:
    """State of charge after a current [A] has flown for a duration [s]; stays within 0 and 1."""
    xp, (charge, current) = as_values(state_of_charge, current)
    left = charge - current * (duration / (SECONDS_PER_HOUR * battery.capacity))
    nothing = xp.zeros_like(left)
    return xp.minimum(xp.maximum(left, nothing), nothing + 1.0)


def _secant(xp: Any, voltage: Array, error: Array, older: Array, older_error: Array) -> Array:
    """Where the line through two points of the residual crosses zero; slope 1 where they coincide."""
    apart = xp.abs(voltage - older) > 1e-6 * voltage
    distance = xp.where(apart, voltage - older, xp.ones_like(voltage))
    slope = xp.where(apart, (error - older_error) / distance, xp.ones_like(voltage))
    return voltage - error / xp.maximum(slope, xp.zeros_like(slope) + _LEAST_SLOPE)


def _held(xp: Any, voltage: Array, low: Array, high: Array, room: float) -> Array:
    """``voltage`` moved so near the middle of its bracket that neither part is wider than ``room`` [V]."""
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    reach = xp.maximum(room - half, xp.zeros_like(half))
    near = xp.minimum(xp.maximum(voltage, middle - reach), middle + reach)
    return xp.where((near > low) & (near < high), near, middle)
