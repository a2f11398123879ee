"""Reading of files that come from elsewhere: regular files of bounded size, refused in one sentence.

A pipe would wait for ever, a device never ends, and a short file can say that it is a long one. Whatever a
stranger may have written goes through one of these functions.
"""

from __future__ import annotations

import json
import math
import os
import re
import stat
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
MOST_LINES = 100_000
"""Most lines of a training's log or learning curve that are read, one an iteration."""
JSON_LIMIT = 8 << 20
"""Largest JSON file that is read [bytes]."""
_DEEPEST = 40  # tables within tables
_WHOLE = 1 << 63  # TOML's whole numbers have 64 bits
_MOST_NAMES = 200_000  # in an object of JSON
_NUMBERS = frozenset((int, float, bool))  # types of a row's values
_LONGEST_ROW = 1 << 16  # characters of a row of a log; trainings write 3000
_LONGEST_LINE = 4000  # the time to read a key grows with the square of its length

# A character that JSON writes with two codes (or a backslash that begins none), and what is left of one then.
_WHOLE_PAIR = re.compile(r"\\\\|\\u[dD][89abAB][0-9a-fA-F]{2}\\u[dD][c-fC-F][0-9a-fA-F]{2}")
_HALF = re.compile(r"\\u[dD][89a-fA-F]")
_LONG_NUMBER = re.compile(r"[0-9]{19}")  # any shorter one has at most 64 bits
_NUMBER = re.compile(r"[-+]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?")

ErrorType = Callable[[str], SprintlabError]


def check_folder(path: str | os.PathLike[str]) -> None:
    """Refuse what is named as a folder to read from, and is none.

    Raises:
        SprintlabError: it does not exist, is something else, or cannot be looked at.
    """
    try:
        is_folder = stat.S_ISDIR(os.stat(path).st_mode)
    except (OSError, ValueError):  # ValueError: a zero byte in the name
        is_folder = False
    if not is_folder:
        raise SprintlabError(f"there is no folder {printable(path)}")


@contextmanager
def open_regular(
    path: str | os.PathLike[str],
    limit: int,
    *,
    what: str = "file",
    error: ErrorType = SprintlabError,
) -> Generator[IO[bytes], None, None]:
    """A regular file to read from; arguments and errors as those of ``read_bytes``."""
    try:
        # Asked before it is opened too: to open some devices does something.
        if not stat.S_ISREG(os.stat(path).st_mode):
            raise error(f"cannot read {what} {printable(path)}: it is no regular file")
        handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except (OSError, ValueError) as reason:  # ValueError: a zero byte in the name
        raise _unreadable(path, what, error, reason) from reason
    status = os.fstat(handle)
    if not stat.S_ISREG(status.st_mode):  # something else has taken its place; Python opens no folder
        os.close(handle)
        raise error(f"cannot read {what} {printable(path)}: it is no regular file")
    with open(handle, "rb") as file:
        if status.st_size > limit:
            raise error(f"{what} {printable(path)} is larger than {_size(limit)}, the most that is read")
        try:
            yield file
        except OSError as reason:
            raise _unreadable(path, what, error, reason) from reason


def _unreadable(path: object, what: str, error: ErrorType, reason: Exception) -> SprintlabError:
    said = getattr(reason, "strerror", None) or str(reason)
    return error(f"cannot read {what} {printable(path)}: {said}")


def read_bytes(
    path: str | os.PathLike[str],
    limit: int,
    *,
    what: str = "file",
    error: ErrorType = SprintlabError,
) -> bytes:
    """Content of a regular file.

    Args:
        path: of the file; a link to a regular file is followed.
        limit: most bytes that it may have.
        what: kind of file, for the sentence.
        error: class of the error that is raised.

    Raises:
        SprintlabError: or what ``error`` makes: missing, unreadable, no regular file (a folder, a pipe, a
            device), or larger than ``limit``.
    """
    with open_regular(path, limit, what=what, error=error) as file:
        content = cast("bytes | None", file.read(limit + 1))  # it may grow meanwhile
    if content is None:  # the kernel's log is called a regular file, and would be waited for
        raise error(f"cannot read {what} {printable(path)}: it gives nothing now")
    if len(content) > limit:
        raise error(f"{what} {printable(path)} is larger than {_size(limit)}, the most that is read")
    return content


def read_text(
    path: str | os.PathLike[str],
    limit: int = TEXT_LIMIT,
    *,
    what: str = "file",
    error: ErrorType = SprintlabError,
) -> str:
    """Content of a regular file of UTF-8 text; a byte order mark is left out. Raises as ``read_bytes``."""
    try:
        return read_bytes(path, limit, what=what, error=error).decode("utf-8-sig")
    except UnicodeDecodeError as reason:
        raise error(f"{what} {printable(path)} is no text in UTF-8: {reason.reason}") from reason


def read_lines(path: str | os.PathLike[str], limit: int, what: str) -> list[str]:
    """Lines of a file that a training wrote, with their ends.

    Args:
        path: of the file.
        limit: most bytes that it may have.
        what: kind of file, for the sentence.

    Raises:
        SprintlabError: as ``read_text``, or it has more than ``MOST_LINES``.
    """
    lines = read_text(path, limit, what=what).splitlines(keepends=True)
    if len(lines) > MOST_LINES:
        raise SprintlabError(
            f"{what} {printable(path)} has more than {MOST_LINES} lines, the most that is read"
        )
    return lines


def read_rows(path: str | os.PathLike[str], limit: int) -> list[dict[str, float]]:
    """Rows of a training's log: names and numbers, one object of JSON a line.

    Raises:
        SprintlabError: as ``read_lines``, or a line is something else.
    """
    try:
        return [_row(line) for line in read_lines(path, limit, "log")]
    except ValueError as error:
        raise SprintlabError(f"{printable(path)} is no training log: {error}") from error


def _row(line: str) -> dict[str, float]:
    # Asked before it is read: lists within lists take Python long, and no row holds any.
    if len(line) > _LONGEST_ROW or "[" in line or line.count("{") != 1:
        raise ValueError("a line is no row of numbers")
    found = parse_json(line)
    row = cast("dict[str, float]", found)
    if not isinstance(found, dict) or not _NUMBERS.issuperset(map(type, row.values())):
        raise ValueError("a line is no row of numbers")
    return dict(zip(map(sys.intern, row), row.values(), strict=True))  # all rows share their names


def read_toml(
    path: str | os.PathLike[str],
    *,
    what: str = "file",
    error: ErrorType = SprintlabError,
) -> dict[str, Any]:
    """Document of a TOML file, whose whole numbers have at most 64 bits, as TOML has them.

    Raises:
        SprintlabError: or what ``error`` makes: as ``read_bytes``, or not TOML, or nested too deeply.
    """
    text = read_text(path, what=what, error=error)
    try:
        return parse_toml(text)
    except ValueError as reason:
        raise error(f"{what} {printable(path)} is not a TOML file: {reason}") from reason


def parse_toml(text: str) -> dict[str, Any]:
    """A TOML document; raises ``ValueError`` for anything else, or for what is nested too deeply."""
    if any(len(line) > _LONGEST_LINE for line in text.splitlines()):
        raise ValueError(f"a line has more than {_LONGEST_LINE} characters")
    try:
        document = tomllib.loads(text)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
    _check_tree(document, 0)
    return document


def read_json(
    path: str | os.PathLike[str],
    what: str = "file",
) -> Any:
    """Content of a JSON file, whose whole numbers have at most 64 bits; NaN and infinity are not JSON.

    Raises:
        SprintlabError: as ``read_bytes``, or not JSON, or nested too deeply.
    """
    text = read_text(path, JSON_LIMIT, what=what)
    try:
        return parse_json(text, finite=True)
    except ValueError as reason:
        raise SprintlabError(f"{what} {printable(path)} is not a JSON file: {reason}") from reason


def parse_json(text: str | bytes, *, finite: bool = False) -> Any:
    """A JSON value; raises ``ValueError`` for anything else, for what is nested too deeply, or named twice.

    Of two equal names in an object JSON does not say which one counts: two readers may take it differently.

    Args:
        text: in UTF-8, where it is bytes.
        finite: whether ``NaN``, ``Infinity`` and numbers beyond all floats are refused.
    """
    plain = text.decode() if isinstance(text, bytes) else text
    try:
        number = _finite_number if finite else float
        whole = _whole_number if _LONG_NUMBER.search(plain) else int  # which is ten times as fast
        value = json.loads(
            plain,
            parse_int=whole,
            parse_float=number,
            parse_constant=number,
            object_pairs_hook=_without_twins,
        )
        if _HALF.search(plain) and _HALF.search(_WHOLE_PAIR.sub("", plain)):
            raise ValueError("a text holds half of a pair of code units")  # which cannot be written
        return value
    except RecursionError:
        raise ValueError("it is nested too deeply") from None


def _without_twins(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    if len(pairs) > _MOST_NAMES:
        raise ValueError(f"an object has more than {_MOST_NAMES} names")
    found = dict(pairs)
    if len(found) < len(pairs):
        seen = set[str]()
        twin = next(name for name, _ in pairs if name in seen or seen.add(name))
        raise ValueError(f"the name {printable(twin, 30)} stands twice in an object")
    return found


def _finite_number(text: str) -> float:
    if not math.isfinite(number := float(text)):
        raise ValueError(f"{printable(text, 30)} is no finite number")
    return number


def plain_number(text: str) -> float:
    """The number of a table's cell, as every program reads it.

    Python's own ``float`` also takes ``2_2.0``, words such as ``nan``, and digits of other scripts.

    Raises:
        ValueError: it is no decimal number in ASCII, or beyond all floats.
    """
    plain = text.strip(" \t\r\n")
    if _NUMBER.fullmatch(plain) is None or not math.isfinite(number := float(plain)):
        raise ValueError(f"{printable(text, 40)!r} is no finite number")
    return number


def table_number(cell: str, column: str, line: int) -> float:
    """The number of a cell as ``plain_number`` reads it; what it refuses is told with its line and column."""
    try:
        return plain_number(cell)
    except ValueError as error:
        raise ValueError(f"line {line}, column {printable(column, 40)}: {error}") from None


@contextmanager
def refused_as_damaged(path: object, how: str = "is damaged") -> Generator[None, None, None]:
    """What numbers of a stranger bring about in the block becomes one sentence about their file.

    Args:
        path: of the file, or what it is.
        how: the sentence goes on.

    Raises:
        SprintlabError: an error of the kinds that impossible numbers lead to.
    """
    try:
        yield
    except SprintlabError:
        raise
    except (
        LookupError, TypeError, ValueError, AttributeError, ArithmeticError, MemoryError, RuntimeError,
    ) as error:  # fmt: skip
        reason = printable(" ".join(str(error).split()) or type(error).__name__, 150)
        raise SprintlabError(f"{printable(path)} {how}: {reason}") from error


def _check_tree(value: Any, depth: int) -> None:
    """Refuse whole numbers of more than 64 bits, and what is nested too deeply. Raises ``ValueError``."""
    if depth > _DEEPEST:
        raise ValueError("it is nested too deeply")
    if isinstance(value, int) and not -_WHOLE <= value < _WHOLE:
        raise ValueError("a whole number has more than 64 bits")
    children: list[Any] = []
    if isinstance(value, dict):
        children = list(cast("dict[str, Any]", value).values())
    elif isinstance(value, list):
        children = cast("list[Any]", value)
    for child in children:
        _check_tree(child, depth + 1)


def _whole_number(digits: str) -> int:
    if len(digits) > 20 or not -_WHOLE <= int(digits) < 2 * _WHOLE:
        raise ValueError("a whole number has more than 64 bits")
    return int(digits)


def _size(count: int) -> str:
    return f"{count >> 20} MB" if count >= 1 << 20 else f"{count >> 10} kB"
