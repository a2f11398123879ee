"""Reading of a robot's parameter table: one TOML file, each number with unit, uncertainty and basis."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sprintlab.core.errors import RobotModelError
from sprintlab.core.reading import read_toml
from sprintlab.motors.parameters import MOTOR_UNITS
from sprintlab.robots.description import JOINTS_PER_LEG, WAIST

_LINK = {"mass": 1, "center_of_mass": 3, "inertia": 3}
_JOINT = {
    "default_angle": 1,
    "range": 2,
    "stiffness": 1,
    "damping": 1,
    "action_scale": 1,
    "viscous_friction": 1,
    "dry_friction": 1,
}
DRIVE_FIELDS = (*MOTOR_UNITS, "gear_ratio", "gear_efficiency")
"""What a joint's drive needs: a motor's parameters, motor side, and its gear."""
_DRIVE_SECTIONS = {
    # joint: where its drive is looked up; the first section that has a quantity decides
    "abad": ("motor.abad", "motor"),
    "hip": ("motor.hip", "motor.hip_knee", "motor"),
    "knee": ("motor.knee", "motor.hip_knee", "motor"),
    "waist": ("motor.waist", "motor.hip_knee", "motor"),
}

_SECTIONS: dict[str, dict[str, int]] = {
    "body": {"total_mass": 1, "base_height_target": 1, "bus_voltage": 1},
    "trunk": {"inertia": 3, "half_size": 3, "hip_x": 1, "hip_y": 1},
    "abad_link": {**_LINK, "offset_y": 1},
    "thigh": {"length": 1, **_LINK, "collision_radius": 1},
    "shank": {"length": 1, **_LINK, "collision_radius": 1},
    "foot": {"mass": 1, "radius": 1, "friction": 1},
    "soft_stop": {"zone": 1, "stiffness": 1, "damping": 1},
    "joint.abad": _JOINT,
    "joint.hip": _JOINT,
    "joint.knee": _JOINT,
}
_SPRING_SECTIONS: dict[str, dict[str, int]] = {
    "knee_carrier": {"mass": 1, "inertia": 3},
    "knee_spring": {"stiffness": 1, "damping": 1, "rest_angle": 1, "range": 2},
}
_BATTERY_SECTION: dict[str, dict[str, int]] = {
    "battery": {"series_cells": 1, "internal_resistance": 1, "capacity": 1}
}
_WAIST_SECTIONS: dict[str, dict[str, int]] = {"rear_trunk": _LINK, "joint.waist": _JOINT}
_OPTIONAL_SECTIONS: dict[str, dict[str, int]] = {
    "body": {"drag_area": 1},
    "trunk": {"center_of_mass": 3, "products_of_inertia": 3},
    **{link: {"products_of_inertia": 3} for link in ("rear_trunk", "abad_link", "thigh", "shank")},
    **{
        section: dict.fromkeys(DRIVE_FIELDS, 1)
        for section in dict.fromkeys(name for names in _DRIVE_SECTIONS.values() for name in names)
    },
}


def _dotted(sections: Mapping[str, Mapping[str, int]]) -> dict[str, int]:
    return {
        f"{section}.{field}": size for section, fields in sections.items() for field, size in fields.items()
    }


REQUIRED = _dotted(_SECTIONS)
"""Every quantity that a robot's table must hold besides its drives, with the length of its value."""
SPRING = _dotted(_SPRING_SECTIONS)
"""Quantities of a series spring in the knee: all of them or none."""
WAIST_QUANTITIES = _dotted(_WAIST_SECTIONS)
"""Quantities of an actuated waist: all of them or none."""
BATTERY = _dotted(_BATTERY_SECTION)
"""Quantities of the battery: all of them or none."""
QUANTITIES: dict[str, int] = {
    **REQUIRED,
    **SPRING,
    **WAIST_QUANTITIES,
    **BATTERY,
    **_dotted(_OPTIONAL_SECTIONS),
}
"""Every quantity that a robot's table may hold, with the length of its value."""

_MOST_LENGTH, _MOST_MASS, _MOST_INERTIA, _MOST_ANGLE = 10.0, 1e4, 1e5, 100.0
_LEAST_LENGTH, _LEAST_MASS, _LEAST_INERTIA = 1e-6, 1e-9, 1e-12
_length, _mass, _angle = (_LEAST_LENGTH, _MOST_LENGTH), (_LEAST_MASS, _MOST_MASS), (-_MOST_ANGLE, _MOST_ANGLE)
_BOUNDS: dict[str, tuple[float, float]] = {
    **dict.fromkeys(("length", "radius", "collision_radius", "half_size", "base_height_target"), _length),
    **dict.fromkeys(("hip_x", "hip_y", "offset_y"), _length),
    "center_of_mass": (-_MOST_LENGTH, _MOST_LENGTH),
    **dict.fromkeys(("mass", "total_mass"), _mass),
    "inertia": (_LEAST_INERTIA, _MOST_INERTIA),
    "products_of_inertia": (-_MOST_INERTIA, _MOST_INERTIA),
    **dict.fromkeys(("default_angle", "range", "rest_angle"), _angle),
    **dict.fromkeys(("zone", "action_scale"), (1e-6, _MOST_ANGLE)),
    "stiffness": (1e-6, 1e5),
    **dict.fromkeys(("damping", "viscous_friction", "dry_friction"), (0.0, 1e4)),
    "friction": (1e-3, 10.0),
    "bus_voltage": (1.0, 2000.0),
    "drag_area": (0.0, 20.0),
    "series_cells": (1.0, 500.0),
    "internal_resistance": (0.0, 10.0),
    "capacity": (1e-3, 1e6),
}
"""Least and greatest number of a quantity, by the last part of its name, in its unit: wide of every robot on
legs, and so near that nothing computed of it overflows. Motors and gears have bounds of their own."""

_ENTRY_FIELDS = ("value", "unit", "uncertainty", "basis")


@dataclass(frozen=True, kw_only=True)
class ParameterRow:
    """One number of a robot, with where it comes from.

    Attributes:
        quantity: dotted name, e.g. ``thigh.length``.
        value: the number, or a tuple of 2 or 3 numbers.
        unit: SI unit; ``1`` for a pure number.
        uncertainty: how wrong the value may be, in words.
        basis: the source or reasoning behind the value.
    """

    quantity: str
    value: float | tuple[float, ...]
    unit: str
    uncertainty: str
    basis: str


@dataclass(frozen=True, kw_only=True)
class ParameterTable:
    """A robot's checked table: ``name`` and the rows by quantity, in the file's order."""

    name: str
    rows: dict[str, ParameterRow]

    def number(self, quantity: str) -> float:
        """Value of a scalar quantity."""
        value = self.rows[quantity].value
        assert not isinstance(value, tuple)
        return value

    def vector(self, quantity: str) -> tuple[float, ...]:
        """Value of a quantity of 2 or 3 numbers."""
        value = self.rows[quantity].value
        assert isinstance(value, tuple)
        return value

    def optional_vector(self, quantity: str) -> tuple[float, ...] | None:
        """Value of a quantity of 3 numbers, None where the table does not have it."""
        return self.vector(quantity) if quantity in self.rows else None

    @property
    def has_knee_spring(self) -> bool:
        """Whether the knee works through a series spring."""
        return any(quantity in self.rows for quantity in SPRING)

    @property
    def has_battery(self) -> bool:
        """Whether the table says which battery the robot carries."""
        return any(quantity in self.rows for quantity in BATTERY)

    @property
    def has_waist(self) -> bool:
        """Whether an actuated joint divides the trunk."""
        return any(quantity in self.rows for quantity in WAIST_QUANTITIES)

    @property
    def joints(self) -> tuple[str, ...]:
        """Kinds of joints: those of a leg, then the waist."""
        return (*JOINTS_PER_LEG, WAIST) if self.has_waist else JOINTS_PER_LEG

    def drive(self, joint: str, field: str) -> str:
        """Name of the quantity that says ``field`` of a joint's drive: the most specific one there is."""
        names = [f"{section}.{field}" for section in _DRIVE_SECTIONS[joint]]
        return next((name for name in names if name in self.rows), names[-1])


def read_table(path: str | Path) -> ParameterTable:
    """Read and check a robot's parameter table.

    Raises:
        RobotModelError: the file cannot be read, is not TOML, or a quantity is missing, unknown or malformed.
    """
    document = read_toml(path, what="robot table", error=RobotModelError)
    try:
        return _checked_table(document)
    except RobotModelError as error:
        raise RobotModelError(f"robot table {path}: {error}") from error


def _checked_table(document: dict[str, Any]) -> ParameterTable:
    name = document.pop("name", None)
    if not isinstance(name, str) or not name:
        raise RobotModelError("field name is missing; it must be the robot's name")
    entries = dict(_entries(document))
    unknown = sorted(set(entries) - set(QUANTITIES))
    if unknown:
        raise RobotModelError(f"unknown quantity {', '.join(unknown)}")
    table = ParameterTable(name=name, rows={key: _row(key, entry) for key, entry in entries.items()})
    missing = _missing(table)
    if missing:
        raise RobotModelError(f"missing quantity {', '.join(missing)}")
    return table


def _missing(table: ParameterTable) -> list[str]:
    """Quantities that the table must still say, in the order of the sections."""
    needed = [*REQUIRED, *(SPRING if table.has_knee_spring else ())]
    needed += WAIST_QUANTITIES if table.has_waist else ()
    needed += BATTERY if table.has_battery else ()
    drives = [table.drive(joint, field) for joint in table.joints for field in DRIVE_FIELDS]
    return [name for name in dict.fromkeys([*needed, *drives]) if name not in table.rows]


def _entries(section: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield ``(dotted name, entry)``: an entry is a table that says anything an entry may say."""
    for key, item in section.items():
        dotted = prefix + key
        if not isinstance(item, Mapping):
            raise RobotModelError(f"{dotted} must be a table with {', '.join(_ENTRY_FIELDS)}")
        if dotted in QUANTITIES or any(field in item for field in _ENTRY_FIELDS):
            yield dotted, item
        else:
            yield from _entries(item, f"{dotted}.")


def _row(quantity: str, entry: Mapping[str, Any]) -> ParameterRow:
    if set(entry) != set(_ENTRY_FIELDS):
        raise RobotModelError(
            f"{quantity} has the fields {', '.join(sorted(entry))}; "
            f"it needs exactly {', '.join(_ENTRY_FIELDS)}"
        )
    words = {field: entry[field] for field in _ENTRY_FIELDS[1:]}
    for field, text in words.items():
        if not isinstance(text, str) or not text:
            raise RobotModelError(f"{quantity}.{field} = {text!r} is not allowed: must be a non-empty text")
    return ParameterRow(quantity=quantity, value=_value(quantity, entry["value"]), **words)


def _value(quantity: str, value: Any) -> float | tuple[float, ...]:
    """The value as a float or a tuple of floats, of the length this quantity must have."""
    size = QUANTITIES[quantity]
    numbers = value if isinstance(value, list) else [value]
    right_form = isinstance(value, list) == (size > 1) and len(numbers) == size
    if not right_form or not all(_is_finite_number(number) for number in numbers):
        wanted = "a finite number" if size == 1 else f"a list of {size} finite numbers"
        raise RobotModelError(f"{quantity}.value = {value!r} is not allowed: must be {wanted}")
    least, greatest = _BOUNDS.get(quantity.rpartition(".")[2], (-np.inf, np.inf))
    if not all(least <= number <= greatest for number in numbers):
        raise RobotModelError(
            f"{quantity}.value = {value!r} is not allowed: must lie in [{least:g}, {greatest:g}]"
        )
    return float(numbers[0]) if size == 1 else tuple(float(number) for number in numbers)


def _is_finite_number(number: object) -> bool:
    return isinstance(number, int | float) and not isinstance(number, bool) and bool(np.isfinite(number))
