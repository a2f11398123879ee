"""Actuators with published parameters: one TOML file each in ``library/``, every number with its source."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from importlib import resources
from typing import Any, cast

from sprintlab.core.checks import check_choice, check_positive
from sprintlab.core.errors import InvalidValueError
from sprintlab.core.reading import parse_toml
from sprintlab.motors.gear import Gear
from sprintlab.motors.parameters import PmsmParameters


@dataclass(frozen=True, kw_only=True)
class LibraryValue:
    """One number of an actuator."""

    value: float  # In SI units
    source: str  # Where it comes from, or what an estimate rests on
    estimated: bool  # Not published: chosen here


@dataclass(frozen=True, kw_only=True)
class LibraryMotor:
    """A motor with its gear on the bus it was published with; plain numbers."""

    name: str
    title: str
    motor: PmsmParameters
    gear: Gear
    bus_voltage: float  # [V]
    values: Mapping[str, LibraryValue]
    """Every number by its name, e.g. ``motor.flux_linkage``, ``gear.ratio``, ``bus_voltage``."""

    @property
    def estimated(self) -> tuple[str, ...]:
        """Names of the numbers that are not published."""
        return tuple(name for name, value in self.values.items() if value.estimated)


def library_motors() -> tuple[str, ...]:
    """Names of the actuators, sorted."""
    names = (entry.name for entry in (resources.files("sprintlab.motors") / "library").iterdir())
    return tuple(sorted(name.removesuffix(".toml") for name in names if name.endswith(".toml")))


def load_library_motor(name: str) -> LibraryMotor:
    """One actuator of the library. Raises ``InvalidValueError`` for another name."""
    check_choice("name", name, library_motors())
    text = (resources.files("sprintlab.motors") / "library" / f"{name}.toml").read_text(encoding="utf-8")
    return actuator_from_toml(name, text)


def actuator_from_toml(name: str, text: str) -> LibraryMotor:
    """An actuator from the text of a library file; ``name`` is that of the file.

    It holds ``title``, and for ``bus_voltage`` and each field of ``motor`` and ``gear`` a table with
    ``value``, ``source`` and, where the number is not published, ``estimated = true``.
    """
    document = parse_toml(text)
    values = {"bus_voltage": _value(f"{name}: bus_voltage", document.get("bus_voltage"))}
    numbers: dict[str, dict[str, float]] = {}
    for group, kind in (("motor", PmsmParameters), ("gear", Gear)):
        table = cast("dict[str, Any]", document.get(group, {}))
        known = [item.name for item in fields(kind)]
        for key in table:
            check_choice(f"{name}: {group}", key, known)
        found = {key: _value(f"{name}: {group}.{key}", table.get(key)) for key in known}
        numbers[group] = {key: value.value for key, value in found.items()}
        values |= {f"{group}.{key}": value for key, value in found.items()}
    check_positive("bus_voltage", values["bus_voltage"].value, "V")
    return LibraryMotor(
        name=name,
        title=str(document["title"]),
        motor=PmsmParameters(**numbers["motor"]),
        gear=Gear(**numbers["gear"]),
        bus_voltage=values["bus_voltage"].value,
        values=values,
    )


def _value(field: str, table: Any) -> LibraryValue:
    """A number that says where it comes from."""
    entry = cast("dict[str, Any]", table) if isinstance(table, dict) else {}
    if "value" not in entry or not str(entry.get("source", "")).strip():
        raise InvalidValueError(field, cast("object", table), "must be a table with value and source")
    estimated = bool(entry.get("estimated", False))
    return LibraryValue(value=float(entry["value"]), source=str(entry["source"]), estimated=estimated)
