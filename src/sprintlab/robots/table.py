"""Reading of a robot's parameter table: one TOML file, each number with unit, uncertainty and basis."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sprintlab.core.errors import RobotModelError
from sprintlab.core.reading import read_toml
from sprintlab.motors.parameters import MOTOR_UNITS
from sprintlab.robots.description import JOINTS_PER_LEG, WAIST

_LINK = {"mass": 1, "center_of_mass": 3, "inertia": 3}
_JOINT = {
    "default_angle": 1,
    "range": 2,
    **dict.fromkeys(("stiffness", "damping", "action_scale", "viscous_friction", "dry_friction"), 1),
}
_DRIVE = dict.fromkeys((*MOTOR_UNITS, "gear_ratio", "gear_efficiency"), 1)
_DRIVE_SECTIONS = {
    # joint: where its drive is looked up; the first section that has a quantity decides
    "abad": ("motor.abad", "motor"),
    "hip": ("motor.hip", "motor.hip_knee", "motor"),
    "knee": ("motor.knee", "motor.hip_knee", "motor"),
    WAIST: ("motor.waist", "motor.hip_knee", "motor"),
}
_REQUIRED = {
    "body": {"total_mass": 1, "base_height_target": 1, "bus_voltage": 1},
    "trunk": {"inertia": 3, "half_size": 3, "hip_x": 1, "hip_y": 1},
    "abad_link": {**_LINK, "offset_y": 1},
    "thigh": {"length": 1, **_LINK, "collision_radius": 1},
    "shank": {"length": 1, **_LINK, "collision_radius": 1},
    "foot": {"mass": 1, "radius": 1, "friction": 1},
    "soft_stop": {"zone": 1, "stiffness": 1, "damping": 1},
    **{f"joint.{joint}": _JOINT for joint in JOINTS_PER_LEG},
}
_GROUPS = {
    "spring": {
        "knee_carrier": {"mass": 1, "inertia": 3},
        "knee_spring": {"stiffness": 1, "damping": 1, "rest_angle": 1, "range": 2},
    },
    "battery": {"battery": {"series_cells": 1, "internal_resistance": 1, "capacity": 1}},
    WAIST: {"rear_trunk": _LINK, f"joint.{WAIST}": _JOINT},
}  # what a robot may have: all quantities of a group or none
_OPTIONAL = {
    "body": {"drag_area": 1},
    "trunk": {"center_of_mass": 3, "products_of_inertia": 3},
    **{link: {"products_of_inertia": 3} for link in ("rear_trunk", "abad_link", "thigh", "shank")},
    **{section: _DRIVE for sections in _DRIVE_SECTIONS.values() for section in sections},
}


def _dotted(sections: Mapping[str, Mapping[str, int]]) -> dict[str, int]:
    return {
        f"{section}.{field}": size for section, fields in sections.items() for field, size in fields.items()
    }


QUANTITIES = {
    **_dotted(_REQUIRED),
    **{name: size for sections in _GROUPS.values() for name, size in _dotted(sections).items()},
    **_dotted(_OPTIONAL),
}
"""Every quantity that a robot's table may hold, with the length of its value."""

_LENGTH, _MASS, _ANGLE = (1e-6, 10.0), (1e-9, 1e4), (-100.0, 100.0)
_BOUNDS: dict[str, tuple[float, float]] = {
    **dict.fromkeys(("length", "radius", "collision_radius", "half_size", "base_height_target"), _LENGTH),
    **dict.fromkeys(("hip_x", "hip_y", "offset_y"), _LENGTH),
    "center_of_mass": (-10.0, 10.0),
    **dict.fromkeys(("mass", "total_mass"), _MASS),
    "inertia": (1e-12, 1e5),
    "products_of_inertia": (-1e5, 1e5),
    **dict.fromkeys(("default_angle", "range", "rest_angle"), _ANGLE),
    **dict.fromkeys(("zone", "action_scale"), (1e-6, 100.0)),
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
    """One number of a robot, with where it comes from."""

    quantity: str  # dotted name, e.g. ``thigh.length``
    value: float | tuple[float, ...]  # the number, or a tuple of 2 or 3 numbers
    unit: str  # SI unit; ``1`` for a pure number
    uncertainty: str  # how wrong the value may be, in words
    basis: str  # the source or reasoning behind the value


def has_part(rows: Mapping[str, object], part: str) -> bool:
    """Whether a table speaks of a robot's ``spring``, ``battery`` or ``waist``."""
    return any(quantity in rows for quantity in _dotted(_GROUPS[part]))


def drive_quantity(rows: Mapping[str, object], joint: str, field: str) -> str:
    """Name of the quantity that says ``field`` of a joint's drive: the most specific one there is."""
    names = [f"{section}.{field}" for section in _DRIVE_SECTIONS[joint]]
    return next((name for name in names if name in rows), names[-1])


def read_table(path: str | Path) -> tuple[str, dict[str, ParameterRow]]:
    """The robot's name and the rows of its table by quantity, in the file's order.

    Raises:
        RobotModelError: the file cannot be read, is not TOML, or a quantity is missing, unknown or malformed.
    """
    document = read_toml(path, what="robot table", error=RobotModelError)
    try:
        return _checked(document)
    except RobotModelError as error:
        raise RobotModelError(f"robot table {path}: {error}") from error


def _checked(document: dict[str, Any]) -> tuple[str, dict[str, ParameterRow]]:
    name = document.pop("name", None)
    if not isinstance(name, str) or not name:
        raise RobotModelError("field name is missing; it must be the robot's name")
    entries = dict(_entries(document))
    if unknown := sorted(set(entries) - set(QUANTITIES)):
        raise RobotModelError(f"unknown quantity {', '.join(unknown)}")
    if missing := _missing(entries):
        raise RobotModelError(f"missing quantity {', '.join(missing)}")
    return name, {quantity: _row(quantity, entry) for quantity, entry in entries.items()}


def _missing(entries: Mapping[str, object]) -> list[str]:
    """Quantities that the table must still say, in the order of the sections."""
    groups = [_dotted(sections) for part, sections in _GROUPS.items() if has_part(entries, part)]
    joints = (*JOINTS_PER_LEG, WAIST) if has_part(entries, WAIST) else JOINTS_PER_LEG
    drives = [drive_quantity(entries, joint, field) for joint in joints for field in _DRIVE]
    needed = dict.fromkeys(name for group in (_dotted(_REQUIRED), *groups, drives) for name in group)
    return [name for name in needed if name not in entries]


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
    least, greatest = _BOUNDS.get(quantity.rpartition(".")[2], (-math.inf, math.inf))
    allowed = f"lie in [{least:g}, {greatest:g}]"
    if not right_form or not all(
        type(number) in (int, float) and abs(number) < math.inf for number in numbers
    ):
        allowed = "be a finite number" if size == 1 else f"be a list of {size} finite numbers"
    elif all(least <= number <= greatest for number in numbers):
        return float(numbers[0]) if size == 1 else tuple(float(number) for number in numbers)
    raise RobotModelError(f"{quantity}.value = {value!r} is not allowed: must {allowed}")
