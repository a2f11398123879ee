"""Atomic writing: a reader sees the old content or the new, never a half; and what a file is known by."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import stat
import tempfile
from collections.abc import Generator
from contextlib import contextmanager, suppress
from datetime import datetime
from pathlib import Path
from typing import Any

from sprintlab.core.errors import InvalidValueError, UnwrittenError

FIGURE_FORMATS = ("png", "pdf", "svg")
"""What a figure can be written as; the ending of its name says which."""


def check_figure_path(path: str | os.PathLike[str] | None) -> None:
    """Refuse a figure that could not be written at the end, before any work; ``None``: no figure."""
    if path is None:
        return
    target = Path(path)
    if target.suffix.removeprefix(".").lower() not in FIGURE_FORMATS:
        allowed = ", ".join(f".{ending}" for ending in FIGURE_FORMATS)
        raise InvalidValueError("figure", str(target), f"its ending says the format: one of {allowed}")
    if not target.parent.is_dir():
        raise InvalidValueError("figure", str(target), f"there is no folder {target.parent}; make it first")
    check_writable_file(target)


@contextmanager
def _told(path: object) -> Generator[None]:
    """What the disk refuses in the block becomes one sentence about the file."""
    try:
        yield
    except OSError as error:
        raise UnwrittenError(f"cannot write {path}: {error.strerror or error}") from error


def atomic_write_bytes(path: str | os.PathLike[str], data: bytes) -> None:
    """Write ``data`` to ``path`` in one step: beside it, then renamed.

    Raises:
        UnwrittenError: the file cannot be written (full disk, no permission), or a device such as
            ``/dev/null`` has the name; nothing is left behind.
    """
    target = Path(path)
    with _told(target):
        _check_replaceable(target)
        target.parent.mkdir(parents=True, exist_ok=True)
        handle, hidden = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name[:100]}.")
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            os.chmod(hidden, 0o644)
            os.replace(hidden, target)
        except BaseException:
            os.unlink(hidden)
            raise


def check_writable(path: str | os.PathLike[str]) -> None:
    """Refuse, before any work, a file or folder that could not be written; leaves nothing behind."""
    place = Path(path).absolute()
    with _told(path):
        _check_replaceable(place)
        place = place.parent
        while not os.path.lexists(place):
            place = place.parent
        with tempfile.TemporaryDirectory(dir=place, prefix=".sprintlab-"):
            pass


def check_writable_file(path: str | os.PathLike[str]) -> None:
    """As ``check_writable``; also refuse the name of a folder."""
    check_writable(path)
    if Path(path).is_dir():
        raise UnwrittenError(f"cannot write {path}: it is a folder")


def check_new_folder(path: str | os.PathLike[str]) -> None:
    """As ``check_writable``; also refuse a name that is taken."""
    if os.path.lexists(path):
        raise UnwrittenError(f"{path} exists already; choose another folder for the results")
    check_writable(path)


def _check_replaceable(path: Path) -> None:
    """Refuse a pipe or a device: as root, a file would take the place of ``/dev/null``."""
    if path.exists() and stat.S_IFMT(path.stat().st_mode) not in (stat.S_IFREG, stat.S_IFDIR):
        raise UnwrittenError(f"cannot write {path}: a pipe, a device or an open file has this name")


def atomic_write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write ``text`` as UTF-8 in one step."""
    atomic_write_bytes(path, text.encode("utf-8", errors="backslashreplace"))


def atomic_write_json(path: str | os.PathLike[str], data: Any) -> None:
    """Write ``data`` as indented JSON; NaN and infinity are refused with ``UnwrittenError``."""
    try:
        text = json.dumps(data, indent=2, allow_nan=False)
    except ValueError as error:
        raise UnwrittenError(f"cannot write {path}: {error}") from error
    atomic_write_text(path, text + "\n")


@contextmanager
def atomic_directory(path: str | os.PathLike[str]) -> Generator[Path]:
    """Yield a temporary folder that becomes ``path`` only if the block ends without an error.

    An empty folder ``path``, such as that of ``reserved_directory``, is replaced.
    """
    target = Path(path)
    with _told(target):
        target.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(dir=target.parent, prefix=f".{target.name[:100]}."))
        try:
            yield temporary
            os.chmod(temporary, 0o755)
            os.replace(temporary, target)
        finally:
            shutil.rmtree(temporary, ignore_errors=True)


def file_sha256(path: str | os.PathLike[str]) -> str:
    """SHA-256 of a file's content, in hexadecimal."""
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


def default_folder(prefix: str = "race") -> Path:
    """``runs/race-<date>-<time>``; a number is added where that is taken."""
    stem = f"{prefix}-{datetime.now():%Y%m%d-%H%M%S}"
    names = (stem, *(f"{stem}-{count}" for count in range(2, 1000)))
    return next(path for name in names if not (path := Path("runs") / name).exists())


@contextmanager
def reserved_directory(path: str | os.PathLike[str]) -> Generator[Path]:
    """Hold a folder's name, as an empty folder, while its content is worked out.

    Of two that ask for the same name at the same time only one gets it. An error in the block removes the
    folder, unless something was put into it.
    """
    target = Path(path)
    check_new_folder(target)
    with _told(target):
        target.mkdir(parents=True)
    try:
        yield target
    except BaseException:
        with suppress(OSError):
            target.rmdir()
        raise
