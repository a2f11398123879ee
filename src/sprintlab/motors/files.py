"""Motor parameters as TOML: one ``[motor]`` table, its keys the fields of ``PmsmParameters``, SI units."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any, cast

import numpy as np
import tomli_w

from sprintlab.core.errors import InvalidValueError
from sprintlab.core.files import atomic_write_text
from sprintlab.core.reading import read_toml
from sprintlab.motors.parameters import PmsmParameters

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
