"""The voltage that an inverter can put across one phase."""

from __future__ import annotations

import math

from sprintlab.core.checks import check_range
from sprintlab.motors.arrays import Array

VOLTAGE_UTILIZATION = 0.95
"""Share of the linear space-vector range that is used, gamma [-]."""


def check_bus_voltage(bus_voltage: float) -> None:
    """Refuse a voltage that no robot's bus has. Raises ``InvalidValueError``."""
    check_range("bus_voltage", bus_voltage, 1.0, 2000.0, "V")


def phase_voltage_limit(bus_voltage: Array) -> Array:
    """Largest phase-voltage amplitude, ``V = gamma V_bus / sqrt(3)`` [V] (linear space-vector modulation).

    A bus voltage in an array is not checked: the host would wait for the device.
    """
    if isinstance(bus_voltage, int | float):
        check_range("bus_voltage", bus_voltage, 0.0, 2000.0, "V")
    return bus_voltage * (VOLTAGE_UTILIZATION / math.sqrt(3.0))
