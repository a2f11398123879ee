"""Parameters of a permanent-magnet synchronous motor, checked when they are put together."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, TypeVar

import numpy as np

from sprintlab.core.checks import check_range, every
from sprintlab.core.errors import InvalidValueError
from sprintlab.motors.arrays import Array, as_arrays

T = TypeVar("T")
# field -> (low, high, unit). Wide enough for any motor of a legged robot, narrow enough to catch a millihenry
# written for a henry or a milliohm for an ohm.
_PLAUSIBLE = {
    "pole_pairs": (1, 200, ""),
    "stator_resistance": (1e-4, 50.0, "ohm"),
    "q_axis_inductance": (0.0, 1e-2, "H"),
    "flux_linkage": (1e-5, 0.5, "Wb"),
    "peak_torque": (1e-4, 5e3, "N m"),
    "saturation": (0.0, 0.5, ""),
    "rotor_inertia": (1e-9, 0.1, "kg m^2"),
}
MOTOR_UNITS = {name: unit for name, (_, _, unit) in _PLAUSIBLE.items()}
"""Fields of ``PmsmParameters`` and of a motor file, with their units."""
_LONGEST_TIME_CONSTANT = 0.05  # L / R [s]; small machines have 0.1 ms to 10 ms
_LARGEST_PEAK_CURRENT = 5e3  # peak torque / torque constant [A]
_LARGEST_RESISTIVE_DROP = 500.0  # R x peak current [V]


@dataclass(frozen=True, kw_only=True)
class PmsmParameters:
    """A permanent-magnet synchronous motor with i_d = 0, seen from the motor's own shaft.

    Amplitude-invariant dq quantities. Each field is a number, or an array (NumPy or PyTorch) with one
    motor an element, e.g. shape ``(12,)``; the shapes broadcast.
    """

    pole_pairs: Array
    """Number of pole pairs N [-]; the electrical speed is N times the mechanical."""
    stator_resistance: Array
    """Resistance R of one phase [ohm]."""
    q_axis_inductance: Array
    """Inductance L of the q axis [H]; 0 gives a motor without reactance."""
    flux_linkage: Array
    """Amplitude psi of the magnet flux linked with one phase [Wb]."""
    peak_torque: Array
    """Torque tau_m at the current limit, before saturation [N m]."""
    saturation: Array = 0.0
    """Share alpha of the torque that is lost at ``peak_torque`` [-], below 0.5."""
    rotor_inertia: Array
    """Moment of inertia of the rotor [kg m^2]."""

    def __post_init__(self) -> None:
        for name, bounds in _PLAUSIBLE.items():
            check_range(name, getattr(self, name), *bounds)
        if not every(self.pole_pairs % 1 == 0):
            raise InvalidValueError("pole_pairs", self.pole_pairs, "must be a whole number")
        if not every(
            self.saturation < 0.5
        ):  # beyond, more current gives less torque: a torque has two currents
            raise InvalidValueError("saturation", self.saturation, "must lie in [0, 0.5)")
        _check_shapes({field.name: getattr(self, field.name) for field in fields(self)})
        _check_units(self)

    @property
    def torque_constant(self) -> Array:
        """Torque per ampere of q-axis current, ``1.5 N psi`` [N m/A]."""
        return 1.5 * self.pole_pairs * self.flux_linkage

    @property
    def speed_constant(self) -> Array:
        """KV: no-load speed per volt of the line-to-line amplitude, ``1 / (sqrt(3) N psi)`` [rad/s/V]."""
        return 1.0 / (math.sqrt(3.0) * self.pole_pairs * self.flux_linkage)


def unchecked(kind: type[T], values: Mapping[str, Array]) -> T:
    """A motor or a gear of these fields without its checks, which make the host of an accelerator wait.

    For motors that change in every step.
    """
    made = object.__new__(kind)
    vars(made).update(values)
    return made


def stack_motors(motors: Sequence[PmsmParameters]) -> PmsmParameters:
    """Put single motors side by side: each field becomes a NumPy array of shape ``(len(motors),)``."""
    if not motors:
        raise InvalidValueError("motors", motors, "give at least one motor")
    return PmsmParameters(
        **{
            field.name: np.array([getattr(motor, field.name) for motor in motors])
            for field in fields(PmsmParameters)
        }
    )


def single(parts: Any, index: int = 0) -> Any:
    """One of several motors or gears side by side: the same class with one number a field."""
    columns = {item.name: np.atleast_1d(getattr(parts, item.name)) for item in fields(parts)}
    return type(parts)(
        **{name: column[min(index, len(column) - 1)].item() for name, column in columns.items()}
    )


def _check_shapes(values: Mapping[str, Any]) -> None:
    shapes: dict[str, tuple[int, ...]] = {
        name: tuple(getattr(value, "shape", ())) for name, value in values.items()
    }
    for name, shape in shapes.items():
        if 0 in shape:
            raise InvalidValueError(name, values[name], "give at least one motor")
    try:
        np.broadcast_shapes(*shapes.values())
    except ValueError as error:
        raise InvalidValueError("shapes", shapes, "the fields must broadcast") from error


def _check_units(motor: PmsmParameters) -> None:
    """Refuse numbers that are possible alone but not together: most often a wrong prefix."""
    _, (resistance, inductance, constant, peak) = as_arrays(
        motor.stator_resistance, motor.q_axis_inductance, motor.torque_constant, motor.peak_torque
    )
    current, unit = peak / constant, "at most {:g} {} is plausible: give henry, ohm, weber and N m"
    for name, derived, most, said in (
        ("q_axis_inductance", inductance / resistance, _LONGEST_TIME_CONSTANT, "L / R is {:.3g} s"),
        ("peak_torque", current, _LARGEST_PEAK_CURRENT, "the peak current would be {:.3g} A"),
        ("stator_resistance", current * resistance, _LARGEST_RESISTIVE_DROP, "R x peak current is {:.3g} V"),
    ):
        if (worst := float(derived.max())) > most:
            allowed = f"{said.format(worst)}, {unit.format(most, said[-1])}"
            raise InvalidValueError(name, getattr(motor, name), allowed)
