"""Reading of files: bounded in size, refused in one sentence that names the file.

``what`` names the kind of file in that sentence, ``error`` is the class that is raised.
"""

from __future__ import annotations

import json
import math
import os
import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import IO, Any, cast

from sprintlab.core.errors import SprintlabError, printable

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

TEXT_LIMIT = 256 << 10
"""Largest table (TOML) that is read [bytes]."""
JSON_LIMIT = 8 << 20
"""Largest JSON file that is read [bytes]."""

ErrorType = Callable[[str], SprintlabError]


@contextmanager
def open_regular(
    path: str | os.PathLike[str], limit: int, *, what: str = "file", error: ErrorType = SprintlabError
) -> Generator[IO[bytes]]:
    """A file to read from.

    Raises:
        SprintlabError: missing, larger than ``limit`` bytes, or a folder, pipe or device.
    """
    if not os.path.exists(path):
        raise error(f"cannot read {what} {path}: No such file or directory")
    if not os.path.isfile(path):
        raise error(f"cannot read {what} {path}: it is not a regular file")
    if os.path.getsize(path) > limit:
        size = f"{limit >> 20} MB" if limit >= 1 << 20 else f"{limit >> 10} kB"
        raise error(f"{what} {path} is larger than {size}, the most that is read")
    try:
        with open(path, "rb") as file:
            yield file
    except OSError as reason:
        raise error(f"cannot read {what} {path}: {reason.strerror or reason}") from reason


def read_bytes(
    path: str | os.PathLike[str], limit: int, *, what: str = "file", error: ErrorType = SprintlabError
) -> bytes:
    """Content of a file. Raises as ``open_regular``."""
    with open_regular(path, limit, what=what, error=error) as file:
        return file.read()


def read_text(
    path: str | os.PathLike[str],
    limit: int = TEXT_LIMIT,
    *,
    what: str = "file",
    error: ErrorType = SprintlabError,
) -> str:
    """Content of a file of UTF-8 text; a byte order mark is left out. Raises as ``open_regular``."""
    try:
        return read_bytes(path, limit, what=what, error=error).decode("utf-8-sig")
    except UnicodeDecodeError as reason:
        raise error(f"{what} {path} is not text in UTF-8: {reason.reason}") from reason


def read_rows(path: str | os.PathLike[str], limit: int) -> list[dict[str, float]]:
    """Rows of a training's log: names and numbers, one JSON object per line."""
    rows: list[dict[str, float]] = []
    for line in read_text(path, limit, what="log").splitlines():
        try:
            row = cast("dict[str, object]", parse_json(line))
        except ValueError as error:
            raise SprintlabError(f"{path} is not a training log: {error}") from error
        if type(row) is not dict or not all(isinstance(value, int | float) for value in row.values()):
            raise SprintlabError(f"{path} is not a training log: a line is not a row of numbers")
        rows.append(cast("dict[str, float]", row))
    return rows


def read_toml(
    path: str | os.PathLike[str], *, what: str = "file", error: ErrorType = SprintlabError
) -> dict[str, Any]:
    """Document of a TOML file. Raises as ``open_regular``, also for a file that is not TOML."""
    text = read_text(path, what=what, error=error)
    try:
        return parse_toml(text)
    except ValueError as reason:
        raise error(f"{what} {path} is not a TOML file: {reason}") from reason


def parse_toml(text: str) -> dict[str, Any]:
    """A TOML document; raises ``ValueError`` for anything else."""
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None


def read_json(path: str | os.PathLike[str], what: str = "file") -> Any:
    """Content of a JSON file with finite numbers. Raises as ``open_regular``, also for any other file."""
    text = read_text(path, JSON_LIMIT, what=what)
    try:
        return parse_json(text, finite=True)
    except ValueError as reason:
        raise SprintlabError(f"{what} {path} is not a JSON file: {reason}") from reason


def parse_json(text: str | bytes, *, finite: bool = False) -> Any:
    """A JSON value; raises ``ValueError`` for anything else, and for NaN and infinity if ``finite``."""
    number = finite_number if finite else float
    try:
        return json.loads(text, parse_float=number, parse_constant=number)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None


def finite_number(text: str) -> float:
    """The number that a text says; raises ``ValueError`` for NaN, infinity and other texts."""
    try:
        if math.isfinite(number := float(text)):
            return number
    except ValueError:
        pass
    raise ValueError(f"{printable(text, 40)!r} is not a finite number")


@contextmanager
def refused_as_damaged(path: object, how: str = "is damaged") -> Generator[None]:
    """Re-raise what impossible numbers in a file lead to as ``SprintlabError``: ``path how: reason``."""
    try:
        yield
    except SprintlabError:
        raise
    except (
        LookupError, TypeError, ValueError, AttributeError, ArithmeticError, MemoryError, RuntimeError,
    ) as error:  # fmt: skip
        reason = " ".join(str(error).split()) or type(error).__name__
        raise SprintlabError(f"{path} {how}: {printable(reason, 150)}") from error
