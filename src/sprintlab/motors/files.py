"""Motors, and what supplies them, as TOML in SI units.

A motor file is one table ``[motor]`` with the fields of ``PmsmParameters``; a supply file has tables
``[battery]``, ``[heat]`` and ``[i2t]``.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np
import tomli_w

from sprintlab.core.errors import InvalidValueError
from sprintlab.core.files import atomic_write_text
from sprintlab.core.reading import read_toml
from sprintlab.motors.battery import Battery
from sprintlab.motors.parameters import PmsmParameters
from sprintlab.motors.thermal import HousedHeat, I2tLimit, WindingHeat

_FIELDS = {field.name: field for field in fields(PmsmParameters)}


def load_motor(path: str | os.PathLike[str]) -> PmsmParameters:
    """Read a motor from a TOML file.

    Args:
        path: file with a ``[motor]`` table; a list of numbers gives one motor an element.

    Raises:
        SprintlabError: the file cannot be read or is no TOML.
        InvalidValueError: a field is unknown, missing, or holds an impossible value; the field is named
            with its file.
    """
    table = _motor_table(Path(path))
    try:
        _check_names(table)
        return PmsmParameters(**{name: _from_toml(value) for name, value in table.items()})
    except InvalidValueError as error:
        raise InvalidValueError(f"{path}: motor.{error.field}", error.value, error.allowed) from error


def save_motor(motor: PmsmParameters, path: str | os.PathLike[str]) -> None:
    """Write a motor as TOML, in one step; ``load_motor`` reads the same numbers back.

    Raises:
        SprintlabError: the file cannot be written; nothing is left behind.
    """
    table = {name: _to_toml(name, getattr(motor, name)) for name in _FIELDS}
    atomic_write_text(path, tomli_w.dumps({"motor": table}))


def _motor_table(path: Path) -> Mapping[str, Any]:
    """The one table of the file."""
    document = read_toml(path, what="motor file")
    if set(document) != {"motor"} or not isinstance(document["motor"], dict):
        raise InvalidValueError(f"{path}", sorted(document), "must hold exactly one table, [motor]")
    return cast("Mapping[str, Any]", document["motor"])


def _check_names(table: Mapping[str, Any]) -> None:
    """Refuse fields that a motor does not have, and motors that lack a field."""
    for name, value in table.items():
        if name not in _FIELDS:
            raise InvalidValueError(name, value, "unknown field; choose among " + ", ".join(_FIELDS))
    for name, field in _FIELDS.items():
        if name not in table and field.default is MISSING:
            raise InvalidValueError(name, None, "the field is missing")


def _from_toml(value: Any) -> Any:
    return np.asarray(cast("list[Any]", value)) if isinstance(value, list) else value


def _to_toml(name: str, value: Any) -> Any:
    numbers = np.asarray(value, dtype=float)
    return (numbers.astype(int) if name == "pole_pairs" else numbers).tolist()


_Table = TypeVar("_Table", Battery, WindingHeat, I2tLimit)
_TABLES = ("battery", "heat", "i2t")


@dataclass(frozen=True, kw_only=True)
class SupplyFile:
    """What a file gives; ``None`` for a table that it lacks."""

    battery: Battery | None
    heat: WindingHeat | None
    i2t: I2tLimit | None


def load_supply(path: str | os.PathLike[str]) -> SupplyFile:
    """Read a battery, a thermal model, an I²t limit; fields that are left out keep their defaults.

    Raises:
        SprintlabError: the file cannot be read or is no TOML.
        InvalidValueError: a table or field is unknown or holds an impossible value; named with the file.
    """
    document = read_toml(path, what="supply file")
    if not document or set(document) - set(_TABLES):
        raise InvalidValueError(
            f"{path}", sorted(document), "must hold the tables [battery], [heat] and [i2t], or some of them"
        )
    return SupplyFile(
        battery=_built(Battery, path, "battery", document.get("battery")),
        heat=_built(_heat_kind(document.get("heat")), path, "heat", document.get("heat")),
        i2t=_built(I2tLimit, path, "i2t", document.get("i2t")),
    )


def save_supply(supply: SupplyFile, path: str | os.PathLike[str]) -> None:
    """Write what a ``SupplyFile`` holds as TOML, in one step; ``load_supply`` reads it.

    Raises:
        SprintlabError: the file cannot be written.
    """
    parts = {name: getattr(supply, name) for name in _TABLES}
    tables = {name: table_of(part) for name, part in parts.items() if part is not None}
    atomic_write_text(path, tomli_w.dumps(tables))


def table_of(part: Battery | WindingHeat | I2tLimit) -> dict[str, Any]:
    """The fields that are set, as numbers and lists of numbers."""
    values = {item.name: getattr(part, item.name) for item in fields(part)}
    return {name: np.asarray(value).tolist() for name, value in values.items() if value is not None}


def _heat_kind(table: Any) -> type[WindingHeat]:
    """Two nodes where the table speaks of a housing."""
    keys = cast("dict[str, Any]", table) if isinstance(table, dict) else {}
    return HousedHeat if any(key.startswith("housing_") for key in keys) else WindingHeat


def _built(kind: type[_Table], path: object, name: str, table: Any) -> _Table | None:
    """One table as its dataclass."""
    if table is None:
        return None
    if not isinstance(table, dict):
        raise InvalidValueError(f"{path}: {name}", table, "must be a table")
    values = cast("dict[str, Any]", table)
    known = {item.name for item in fields(kind)}
    for field, value in values.items():
        if field not in known:
            raise InvalidValueError(
                f"{path}: {name}.{field}", value, "choose among " + ", ".join(sorted(known))
            )
    try:
        return kind(**{field: _value(kind, value) for field, value in values.items()})
    except InvalidValueError as error:
        raise InvalidValueError(f"{path}: {error.field}", error.value, error.allowed) from error
    except (TypeError, ValueError, OverflowError) as error:
        raise InvalidValueError(f"{path}: {name}", values, "give numbers and lists of numbers") from error


def _value(kind: type[Battery] | type[WindingHeat] | type[I2tLimit], value: Any) -> Any:
    """A list is a table of a battery, or one number a motor."""
    if not isinstance(value, list):
        return value
    numbers = cast("list[Any]", value)
    return tuple(numbers) if kind is Battery else np.asarray(numbers, dtype=float)
