"""Reading of files from elsewhere: bounded in size, refused in one sentence that names the file."""

from __future__ import annotations

import json
import math
import os
import re
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
_WHOLE = 1 << 63  # TOML's whole numbers have 64 bits
_NUMBER = re.compile(r"[-+]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?")

ErrorType = Callable[[str], SprintlabError]


def check_folder(path: str | os.PathLike[str]) -> None:
    """Refuse a folder to read from that does not exist. Raises ``SprintlabError``."""
    if not os.path.isdir(path):
        raise SprintlabError(f"there is no folder {path}")


def check_file(
    path: str | os.PathLike[str], limit: int, *, what: str = "file", error: ErrorType = SprintlabError
) -> None:
    """Refuse a missing or too large file, and pipes and devices, before it is opened.

    Args:
        path: path of the file; a link to a file is followed.
        limit: most bytes that it may have.
        what: kind of file, for the sentence.
        error: class of the error that is raised.

    Raises:
        SprintlabError: or what ``error`` makes.
    """
    if not os.path.exists(path):
        raise error(f"cannot read {what} {path}: No such file or directory")
    if not os.path.isfile(path):
        raise error(f"cannot read {what} {path}: it is not a regular file")
    if os.path.getsize(path) > limit:
        size = f"{limit >> 20} MB" if limit >= 1 << 20 else f"{limit >> 10} kB"
        raise error(f"{what} {path} is larger than {size}, the most that is read")


@contextmanager
def open_regular(
    path: str | os.PathLike[str], limit: int, *, what: str = "file", error: ErrorType = SprintlabError
) -> Generator[IO[bytes]]:
    """A file to read from; arguments and errors as those of ``check_file``."""
    check_file(path, limit, what=what, error=error)
    try:
        with open(path, "rb") as file:
            yield file
    except OSError as reason:
        raise error(f"cannot read {what} {path}: {reason.strerror or reason}") from reason


def read_bytes(
    path: str | os.PathLike[str], limit: int, *, what: str = "file", error: ErrorType = SprintlabError
) -> bytes:
    """Content of a file; arguments and errors as those of ``check_file``."""
    with open_regular(path, limit, what=what, error=error) as file:
        return file.read()


def read_text(
    path: str | os.PathLike[str],
    limit: int = TEXT_LIMIT,
    *,
    what: str = "file",
    error: ErrorType = SprintlabError,
) -> str:
    """Content of a file of UTF-8 text; a byte order mark is left out. Raises as ``check_file``."""
    try:
        return read_bytes(path, limit, what=what, error=error).decode("utf-8-sig")
    except UnicodeDecodeError as reason:
        raise error(f"{what} {path} is not text in UTF-8: {reason.reason}") from reason


def read_lines(path: str | os.PathLike[str], limit: int, what: str) -> list[str]:
    """Lines of a text file with their ends. Raises as ``check_file``."""
    return read_text(path, limit, what=what).splitlines(keepends=True)


def read_rows(path: str | os.PathLike[str], limit: int) -> list[dict[str, float]]:
    """Rows of a training's log: names and numbers, one JSON object per line.

    Raises:
        SprintlabError: as ``check_file``, or a line is something else.
    """
    try:
        return [_row(line) for line in read_lines(path, limit, "log")]
    except ValueError as error:
        raise SprintlabError(f"{path} is not a training log: {error}") from error


def _row(line: str) -> dict[str, float]:
    row = parse_json(line)
    if not isinstance(row, dict):
        raise ValueError("a line is not a row of numbers")
    values = cast("dict[str, Any]", row)
    if not all(isinstance(value, int | float) for value in values.values()):
        raise ValueError("a line is not a row of numbers")
    return values


def read_toml(
    path: str | os.PathLike[str], *, what: str = "file", error: ErrorType = SprintlabError
) -> dict[str, Any]:
    """Document of a TOML file.

    Raises:
        SprintlabError: or what ``error`` makes: as ``check_file``, or not TOML.
    """
    text = read_text(path, what=what, error=error)
    try:
        return parse_toml(text)
    except ValueError as reason:
        raise error(f"{what} {path} is not a TOML file: {reason}") from reason


def parse_toml(text: str) -> dict[str, Any]:
    """A TOML document; raises ``ValueError`` for anything else."""
    try:
        document = tomllib.loads(text)
        _check_whole_numbers(document)
        return document
    except RecursionError:
        raise ValueError("it is nested too deeply") from None


def _check_whole_numbers(value: Any) -> None:
    """Refuse whole numbers of more than 64 bits, which no float and no array holds. Raises ``ValueError``."""
    if isinstance(value, int) and not -_WHOLE <= value < _WHOLE:
        raise ValueError("a whole number has more than 64 bits")
    if isinstance(value, dict):
        value = list(cast("dict[str, Any]", value).values())
    if isinstance(value, list):
        for item in cast("list[Any]", value):
            _check_whole_numbers(item)


def read_json(path: str | os.PathLike[str], what: str = "file") -> Any:
    """Content of a JSON file; NaN and infinity are not JSON.

    Raises:
        SprintlabError: as ``check_file``, or not JSON.
    """
    text = read_text(path, JSON_LIMIT, what=what)
    try:
        return parse_json(text, finite=True)
    except ValueError as reason:
        raise SprintlabError(f"{what} {path} is not a JSON file: {reason}") from reason


def parse_json(text: str | bytes, *, finite: bool = False) -> Any:
    """A JSON value; raises ``ValueError`` for anything else.

    Args:
        text: in UTF-8, where it is bytes.
        finite: whether ``NaN``, ``Infinity`` and numbers beyond all floats are refused.
    """
    number = _finite_number if finite else float
    try:
        return json.loads(text, parse_float=number, parse_constant=number)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None


def _finite_number(text: str) -> float:
    if not math.isfinite(number := float(text)):
        raise ValueError(f"{text[:30]} is not a finite number")
    return number


def plain_number(text: str) -> float:
    """The number of a table's cell, as every program reads it.

    Python's own ``float`` also takes ``2_2.0``, words such as ``nan``, and digits of other scripts.

    Raises:
        ValueError: it is not a decimal number in ASCII, or beyond all floats.
    """
    plain = text.strip(" \t\r\n")
    if _NUMBER.fullmatch(plain) is None or not math.isfinite(number := float(plain)):
        raise ValueError(f"{printable(text, 40)!r} is not a finite number")
    return number


def table_number(cell: str, column: str, line: int) -> float:
    """The number of a cell as ``plain_number`` reads it; an error names its line and column."""
    try:
        return plain_number(cell)
    except ValueError as error:
        raise ValueError(f"line {line}, column {printable(column, 40)}: {error}") from None


@contextmanager
def refused_as_damaged(path: object, how: str = "is damaged") -> Generator[None]:
    """Re-raise errors that impossible numbers in a file lead to as one sentence about the file.

    Args:
        path: path of the file.
        how: the sentence goes on.

    Raises:
        SprintlabError: the block raised one of those errors.
    """
    try:
        yield
    except SprintlabError:
        raise
    except (
        LookupError, TypeError, ValueError, AttributeError, ArithmeticError, MemoryError, RuntimeError,
    ) as error:  # fmt: skip
        reason = " ".join(str(error).split()) or type(error).__name__
        raise SprintlabError(f"{path} {how}: {printable(reason, 150)}") from error
