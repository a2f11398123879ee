"""Reading of a robot's parameter table: one TOML file, each number with unit, uncertainty and basis."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from sprintlab.core.errors import RobotModelError
from sprintlab.core.reading import read_toml
from sprintlab.motors.parameters import MOTOR_UNITS
from sprintlab.robots.description import JOINTS_PER_LEG, WAIST


class Kind(NamedTuple):
    """What the quantities of one name may be."""

    unit: str
    low: float  # least and greatest number: wide of every robot on legs, and nothing computed overflows
    high: float
    size: int = 1  # how many numbers


_LENGTHS = ("length", "radius", "collision_radius", "base_height_target", "hip_x", "hip_y", "offset_y")
KINDS = {
    **dict.fromkeys(_LENGTHS, Kind("m", 1e-6, 10.0)),
    "half_size": Kind("m", 1e-6, 10.0, 3),
    "center_of_mass": Kind("m", -10.0, 10.0, 3),
    **dict.fromkeys(("mass", "total_mass"), Kind("kg", 1e-9, 1e4)),
    "inertia": Kind("kg m^2", 1e-12, 1e5, 3),
    "products_of_inertia": Kind("kg m^2", -1e5, 1e5, 3),
    **dict.fromkeys(("default_angle", "rest_angle"), Kind("rad", -100.0, 100.0)),
    "range": Kind("rad", -100.0, 100.0, 2),
    **dict.fromkeys(("zone", "action_scale"), Kind("rad", 1e-6, 100.0)),
    "stiffness": Kind("N m/rad", 1e-6, 1e5),
    **dict.fromkeys(("damping", "viscous_friction"), Kind("N m s/rad", 0.0, 1e4)),
    "dry_friction": Kind("N m", 0.0, 1e4),
    "friction": Kind("1", 1e-3, 10.0),
    "bus_voltage": Kind("V", 1.0, 2000.0),
    "drag_area": Kind("m^2", 0.0, 20.0),
    "series_cells": Kind("1", 1.0, 500.0),
    "internal_resistance": Kind("ohm", 0.0, 10.0),
    "capacity": Kind("A h", 1e-3, 1e6),
    # motors and gears have bounds of their own
    **{name: Kind(unit or "1", -math.inf, math.inf) for name, unit in MOTOR_UNITS.items()},
    **dict.fromkeys(("gear_ratio", "gear_efficiency"), Kind("1", -math.inf, math.inf)),
}
"""By the last part of a quantity's name."""

_LINK = ("mass", "center_of_mass", "inertia")
_SHAPED_LINK = ("length", *_LINK, "collision_radius")
_GAINS = ("stiffness", "damping", "action_scale", "viscous_friction", "dry_friction")
_JOINT = ("default_angle", "range", *_GAINS)
_DRIVE = (*MOTOR_UNITS, "gear_ratio", "gear_efficiency")
_DRIVE_SECTIONS = {
    # joint: where its drive is looked up; the first section that has a quantity decides
    "abad": ("motor.abad", "motor"),
    "hip": ("motor.hip", "motor.hip_knee", "motor"),
    "knee": ("motor.knee", "motor.hip_knee", "motor"),
    WAIST: ("motor.waist", "motor.hip_knee", "motor"),
}
_REQUIRED = {
    "body": ("total_mass", "base_height_target", "bus_voltage"),
    "trunk": ("inertia", "half_size", "hip_x", "hip_y"),
    "abad_link": (*_LINK, "offset_y"),
    "thigh": _SHAPED_LINK,
    "shank": _SHAPED_LINK,
    "foot": ("mass", "radius", "friction"),
    "soft_stop": ("zone", "stiffness", "damping"),
    **{f"joint.{joint}": _JOINT for joint in JOINTS_PER_LEG},
}
_GROUPS = {
    "spring": {
        "knee_carrier": ("mass", "inertia"),
        "knee_spring": ("stiffness", "damping", "rest_angle", "range"),
    },
    "battery": {"battery": ("series_cells", "internal_resistance", "capacity")},
    WAIST: {"rear_trunk": _LINK, f"joint.{WAIST}": _JOINT},
}  # what a robot may have: all quantities of a group or none
_OPTIONAL = {
    "body": ("drag_area",),
    "trunk": ("center_of_mass", "products_of_inertia"),
    **dict.fromkeys(("rear_trunk", "abad_link", "thigh", "shank"), ("products_of_inertia",)),
    **{section: _DRIVE for sections in _DRIVE_SECTIONS.values() for section in sections},
}


def _dotted(sections: Mapping[str, Sequence[str]]) -> list[str]:
    return [f"{section}.{field}" for section, fields in sections.items() for field in fields]


QUANTITIES = [name for part in (_REQUIRED, *_GROUPS.values(), _OPTIONAL) for name in _dotted(part)]
"""Every quantity that a robot's table may hold."""

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
    """The robot's name and the rows of its table by quantity, in the file's order."""
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
    kind = KINDS[quantity.rpartition(".")[2]]
    if entry["unit"] != kind.unit:
        raise RobotModelError(f"{quantity}.unit = {entry['unit']!r} is not allowed: must be {kind.unit!r}")
    return ParameterRow(quantity=quantity, value=_value(quantity, entry["value"], kind), **words)


def _value(quantity: str, value: Any, kind: Kind) -> float | tuple[float, ...]:
    """The value as a float or a tuple of floats, of the length that this quantity must have."""
    numbers = value if isinstance(value, list) else [value]
    right_form = isinstance(value, list) == (kind.size > 1) and len(numbers) == kind.size
    allowed = f"lie in [{kind.low:g}, {kind.high:g}]"
    if not right_form or not all(
        type(number) in (int, float) and abs(number) < math.inf for number in numbers
    ):
        allowed = "be a finite number" if kind.size == 1 else f"be a list of {kind.size} finite numbers"
    elif all(kind.low <= number <= kind.high for number in numbers):
        return float(numbers[0]) if kind.size == 1 else tuple(float(number) for number in numbers)
    raise RobotModelError(f"{quantity}.value = {value!r} is not allowed: must {allowed}")
