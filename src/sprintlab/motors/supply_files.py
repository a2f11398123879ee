"""Battery and winding heat as TOML: tables ``[battery]`` and ``[heat]``, their keys the fields (SI units)."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np

from sprintlab.core.errors import InvalidValueError
from sprintlab.core.reading import read_toml
from sprintlab.motors.battery import Battery
from sprintlab.motors.thermal import WindingHeat

_Table = TypeVar("_Table", Battery, WindingHeat)


@dataclass(frozen=True, kw_only=True)
class SupplyFile:
    """What a file gives; ``None`` for a table that it lacks."""

    battery: Battery | None
    heat: WindingHeat | None


def load_supply(path: str | os.PathLike[str]) -> SupplyFile:
    """Read a battery, a thermal model, or both; fields that are left out keep their defaults.

    Raises:
        SprintlabError: the file cannot be read or is no TOML.
        InvalidValueError: a table or field is unknown or holds an impossible value; named with the file.
    """
    document = _document(Path(path))
    if not document or set(document) - {"battery", "heat"}:
        raise InvalidValueError(
            f"{path}", sorted(document), "must hold the tables [battery] and [heat], or one"
        )
    return SupplyFile(
        battery=_built(Battery, path, "battery", document.get("battery")),
        heat=_built(WindingHeat, path, "heat", document.get("heat")),
    )


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


def _value(kind: type[Battery] | type[WindingHeat], value: Any) -> Any:
    """A list is a table of a battery, or one number a motor."""
    if not isinstance(value, list):
        return value
    numbers = cast("list[Any]", value)
    return tuple(numbers) if kind is Battery else np.asarray(numbers, dtype=float)
