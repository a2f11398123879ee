"""Motors, and what supplies them, as TOML in SI units.

A motor file is one table ``[motor]`` with the fields of ``PmsmParameters``; a supply file has tables
``[battery]``, ``[heat]`` and ``[i2t]``.
"""

from __future__ import annotations

import os
from dataclasses import MISSING, dataclass, fields
from typing import Any, cast

import numpy as np
import tomli_w

from sprintlab.core.errors import InvalidValueError
from sprintlab.core.files import atomic_write_text
from sprintlab.core.reading import read_toml
from sprintlab.motors.battery import Battery
from sprintlab.motors.parameters import PmsmParameters
from sprintlab.motors.thermal import HousedHeat, I2tLimit, WindingHeat

_TABLES = ("battery", "heat", "i2t")


def load_motor(path: str | os.PathLike[str]) -> PmsmParameters:
    """Read the ``[motor]`` table of a TOML file; a list of numbers gives one motor an element."""
    document = read_toml(path, what="motor file")
    if set(document) != {"motor"}:
        raise InvalidValueError(f"{path}", sorted(document), "must hold exactly one table, [motor]")
    return _built(path, PmsmParameters, "motor", document["motor"])


def save_motor(motor: PmsmParameters, path: str | os.PathLike[str]) -> None:
    """Write a motor as TOML, in one step; ``load_motor`` reads the same numbers back."""
    atomic_write_text(path, tomli_w.dumps({"motor": table_of(motor)}))


@dataclass(frozen=True, kw_only=True)
class SupplyFile:
    """What a file gives; ``None`` for a table that it lacks."""

    battery: Battery | None
    heat: WindingHeat | None
    i2t: I2tLimit | None


def load_supply(path: str | os.PathLike[str]) -> SupplyFile:
    """Read a battery, a thermal model, an I²t limit; fields that are left out keep their defaults."""
    document = read_toml(path, what="supply file")
    if not document or set(document) - set(_TABLES):
        allowed = "must hold the tables [battery], [heat] and [i2t], or some of them"
        raise InvalidValueError(f"{path}", sorted(document), allowed)
    housed = "housing_" in str(document.get("heat"))  # two thermal nodes where the table speaks of a housing
    kinds = {"battery": Battery, "heat": HousedHeat if housed else WindingHeat, "i2t": I2tLimit}
    parts = {name: _built(path, kinds[name], name, table) for name, table in document.items()}
    return SupplyFile(**dict.fromkeys(_TABLES) | parts)


def save_supply(supply: SupplyFile, path: str | os.PathLike[str]) -> None:
    """Write what a ``SupplyFile`` holds as TOML, in one step."""
    parts = {name: getattr(supply, name) for name in _TABLES}
    tables = {name: table_of(part) for name, part in parts.items() if part is not None}
    atomic_write_text(path, tomli_w.dumps(tables))


def table_of(part: PmsmParameters | Battery | WindingHeat | I2tLimit) -> dict[str, Any]:
    """The fields that are set, as numbers and lists of numbers."""
    values = {item.name: getattr(part, item.name) for item in fields(part)}
    found = {name: np.asarray(value) for name, value in values.items() if value is not None}
    return {
        name: (value.astype(int) if name == "pole_pairs" else value).tolist() for name, value in found.items()
    }


def _built(path: str | os.PathLike[str], kind: Any, name: str, table: Any) -> Any:
    """A table of a file as its dataclass; a list is a table of a battery, or one number a motor."""
    known = {item.name: item for item in fields(kind)}
    if not isinstance(table, dict):
        raise InvalidValueError(f"{path}: {name}", table, "must be a table")
    values = cast("dict[str, Any]", table)
    for field in values:
        if field not in known:
            allowed = "unknown; choose among " + ", ".join(known)
            raise InvalidValueError(f"{path}: {name}.{field}", values[field], allowed)
    for field, item in known.items():
        if field not in values and item.default is MISSING:
            raise InvalidValueError(f"{path}: {name}.{field}", None, "the field is missing")
    several: Any = tuple if kind is Battery else np.asarray
    try:
        return kind(
            **{key: several(item) if isinstance(item, list) else item for key, item in values.items()}
        )
    except InvalidValueError as error:
        field = f"{name}.{error.field.removeprefix(f'{name}.')}"
        raise InvalidValueError(f"{path}: {field}", error.value, error.allowed) from error
    except (TypeError, ValueError, OverflowError) as error:
        raise InvalidValueError(f"{path}: {name}", values, "give numbers and lists of numbers") from error
