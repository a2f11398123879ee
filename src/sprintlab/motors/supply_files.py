"""Battery, heat and I²t as TOML: tables ``[battery]``, ``[heat]`` and ``[i2t]``, in SI units."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np
import tomli_w

from sprintlab.core.errors import InvalidValueError
from sprintlab.core.files import atomic_write_text
from sprintlab.core.reading import read_toml
from sprintlab.motors.battery import Battery
from sprintlab.motors.i2t import I2tLimit
from sprintlab.motors.thermal import HousedHeat, WindingHeat

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
    document = _document(Path(path))
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


def _document(path: Path) -> Mapping[str, Any]:
    return read_toml(path, what="supply file")


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
