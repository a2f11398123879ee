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

    value: float
    """In SI units."""
    source: str
    """Where it comes from, or what an estimate rests on."""
    estimated: bool
    """Not published: chosen here."""


@dataclass(frozen=True, kw_only=True)
class LibraryMotor:
    """A motor with its gear on the bus it was published with; plain numbers.

    Raises:
        InvalidValueError: the bus voltage is not positive.
    """

    name: str
    title: str
    motor: PmsmParameters
    gear: Gear
    bus_voltage: float
    """[V]"""
    values: Mapping[str, LibraryValue]
    """Every number by its name, e.g. ``motor.flux_linkage``, ``gear.ratio``, ``bus_voltage``."""

    def __post_init__(self) -> None:
        """Refuse an actuator without a supply."""
        check_positive("bus_voltage", self.bus_voltage, "V")

    @property
    def estimated(self) -> tuple[str, ...]:
        """Names of the numbers that are not published."""
        return tuple(name for name, value in self.values.items() if value.estimated)


def library_motors() -> tuple[str, ...]:
    """Names of the actuators, sorted."""
    names = (entry.name for entry in (resources.files("sprintlab.motors") / "library").iterdir())
    return tuple(sorted(name.removesuffix(".toml") for name in names if name.endswith(".toml")))


def load_library_motor(name: str) -> LibraryMotor:
    """One actuator of the library.

    Raises:
        InvalidValueError: there is no such actuator.
    """
    check_choice("name", name, library_motors())
    text = (resources.files("sprintlab.motors") / "library" / f"{name}.toml").read_text(encoding="utf-8")
    return actuator_from_toml(name, text)


def actuator_from_toml(name: str, text: str) -> LibraryMotor:
    """An actuator from the text of a library file.

    Args:
        name: names the file in errors.
        text: ``title``, and for ``bus_voltage`` and each field of ``motor`` and ``gear`` a table with
            ``value``, ``source`` and, where the number is not published, ``estimated = true``.

    Raises:
        InvalidValueError: a number or its source is missing, unknown or impossible.
    """
    document = parse_toml(text)
    values = {"bus_voltage": _value(f"{name}: bus_voltage", document.get("bus_voltage"))}
    for group, kind in (("motor", PmsmParameters), ("gear", Gear)):
        table = cast("dict[str, Any]", document.get(group, {}))
        known = [item.name for item in fields(kind)]
        for key in table:
            check_choice(f"{name}: {group}", key, known)
        values |= {f"{group}.{key}": _value(f"{name}: {group}.{key}", table.get(key)) for key in known}
    return LibraryMotor(
        name=name,
        title=str(document["title"]),
        motor=PmsmParameters(**_numbers(values, "motor")),
        gear=Gear(**_numbers(values, "gear")),
        bus_voltage=values["bus_voltage"].value,
        values=values,
    )


def _value(field: str, table: Any) -> LibraryValue:
    """A number that says where it comes from."""
    entry = cast("dict[str, Any]", table) if isinstance(table, dict) else {}
    if not {"value", "source"} <= set(entry):
        raise InvalidValueError(field, cast("object", table), "must be a table with value and source")
    if not str(entry["source"]).strip():
        raise InvalidValueError(f"{field}.source", entry["source"], "must name a source")
    return LibraryValue(
        value=float(entry["value"]),
        source=str(entry["source"]),
        estimated=bool(entry.get("estimated", False)),
    )


def _numbers(values: Mapping[str, LibraryValue], group: str) -> dict[str, float]:
    return {
        name.removeprefix(f"{group}."): value.value
        for name, value in values.items()
        if name.startswith(f"{group}.")
    }
