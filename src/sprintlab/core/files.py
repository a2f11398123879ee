"""Atomic writing: a reader sees the old content or the new, never a half."""

from __future__ import annotations

import errno
import json
import os
import re
import secrets
import shutil
import stat
import sys
import tempfile
from collections.abc import Generator
from contextlib import contextmanager, suppress
from datetime import datetime
from pathlib import Path
from typing import IO, Any

from sprintlab.core.errors import InvalidValueError, UnwrittenError

FIGURE_FORMATS = ("png", "pdf", "svg")
"""What a figure can be written as; the ending of its name says which."""

_UNFINISHED = ".sprintlab-unfinished"
"""How the names of files and folders end that are not complete."""
_LEFT = re.compile(rf"\.[0-9a-f]{{8}}{re.escape(_UNFINISHED)}")
_TAKEN = (errno.ENOTEMPTY, errno.EEXIST, errno.ENOTDIR)  # what systems say of a folder's name
_LEFT_FOLDER = re.compile(rf"\.([0-9a-f]{{1,16}})-[0-9a-f]{{8}}{re.escape(_UNFINISHED)}")


def check_figure_path(path: str | os.PathLike[str] | None) -> None:
    """Refuse a figure that could not be written at the end, before any work is spent on it.

    Args:
        path: the file to come; ``None`` where no figure was asked for.

    Raises:
        InvalidValueError: the ending is not one of ``FIGURE_FORMATS``, or the folder does not exist.
        UnwrittenError: as ``check_writable_file``.
    """
    if path is None:
        return
    target = Path(path)
    if target.suffix.removeprefix(".").lower() not in FIGURE_FORMATS:
        allowed = ", ".join(f".{ending}" for ending in FIGURE_FORMATS)
        raise InvalidValueError("figure", str(target), f"its ending says the format: one of {allowed}")
    if not target.parent.is_dir():
        raise InvalidValueError("figure", str(target), f"there is no folder {target.parent}; make it first")
    check_writable_file(target)


def atomic_write_bytes(path: str | os.PathLike[str], data: bytes) -> None:
    """Write ``data`` to ``path`` in one step.

    On Linux the new file has no name before it is complete: a process that is killed while it writes leaves
    nothing, and what one killed in its very last step left is removed by the next write into the folder.

    Raises:
        UnwrittenError: the file cannot be written (full disk, no permission), or something that is no file,
            such as ``/dev/null``, has the name; nothing is left behind.
    """
    target = _place(path)
    try:
        _check_replaceable(target)
        target.parent.mkdir(parents=True, exist_ok=True)
        if not _written_nameless(target, data):
            _write_hidden(target, data)
    except OSError as error:
        raise UnwrittenError(f"cannot write {target}: {error.strerror or error}") from error


def _place(path: str | os.PathLike[str]) -> Path:
    """A name as a path. Raises ``UnwrittenError`` for one with a zero byte, which no disk knows."""
    if "\0" in os.fspath(path):
        raise UnwrittenError(f"cannot write {path}: no name holds a zero byte")
    return Path(path)


def _written_nameless(target: Path, data: bytes) -> bool:
    """Write a file that has no name until it is complete; False where the system or its disk knows none."""
    try:
        handle = os.open(target.parent, os.O_TMPFILE | os.O_WRONLY | os.O_CLOEXEC, 0o600)
    except (AttributeError, OSError):
        return False
    with os.fdopen(handle, "wb") as file:
        _fill(file, data)
        os.chmod(handle, 0o644)
        _remove_left(target.parent)
        hidden = target.with_name(f".{secrets.token_hex(4)}{_UNFINISHED}")
        try:
            _hold(handle, wait=False)
            # With a folder, it follows a link such as that of /proc.
            os.link(f"/proc/self/fd/{handle}", hidden, src_dir_fd=handle)
        except OSError:
            return False
        try:
            os.replace(hidden, target)
        except BaseException:
            os.unlink(hidden)
            raise
    return True


def _write_hidden(target: Path, data: bytes) -> None:
    """Write a hidden file beside ``target``, then move it there."""
    handle, hidden = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.")
    try:
        with os.fdopen(handle, "wb") as file:
            _fill(file, data)
        os.chmod(hidden, 0o644)
        os.replace(hidden, target)
    except BaseException:
        os.unlink(hidden)
        raise


def _fill(file: IO[bytes], data: bytes) -> None:
    file.write(data)
    file.flush()
    os.fsync(file.fileno())


def _remove_left(folder: Path) -> None:
    """Remove complete files of processes that were killed before they could move them: nobody holds them."""
    for path in folder.glob(f".*{_UNFINISHED}"):
        with suppress(OSError):
            _remove_if_left(path)


def _remove_if_left(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        if (
            _LEFT.fullmatch(path.name)
            and stat.S_ISREG(os.fstat(handle).st_mode)
            and _hold(handle, wait=False)
        ):
            path.unlink()
    finally:
        os.close(handle)


def check_writable(path: str | os.PathLike[str]) -> None:
    """Refuse, before any work, a place where nothing can be written; leaves nothing behind.

    Args:
        path: of the file or folder that is to be written; folders above it may be missing.

    Raises:
        UnwrittenError: a folder above it is a file or a link to nowhere, nothing can be made there, or a
            pipe, a device or a link to itself has the name.
    """
    place = _place(path).absolute()
    try:
        _check_replaceable(place)
        place = place.parent
        while not os.path.lexists(place):
            place = place.parent
        with tempfile.TemporaryDirectory(dir=place, prefix=".sprintlab-"):
            pass
    except OSError as error:
        raise UnwrittenError(f"cannot write {path}: {place}: {error.strerror or error}") from error


def check_writable_file(path: str | os.PathLike[str]) -> None:
    """Refuse, before any work, a file that could not be written at its end.

    Raises:
        UnwrittenError: as ``check_writable``, or a folder has the name.
    """
    check_writable(path)
    if _place(path).is_dir():  # a path: no name at all is the folder one is in
        raise UnwrittenError(f"cannot write {path}: it is a folder")


def _check_replaceable(path: Path) -> None:
    """Refuse a name that something has whose place no file may take: as root, ``/dev/null`` would be gone.

    Raises:
        UnwrittenError: a pipe, a device, a socket or a link to an open file (``/dev/stdout``) has the name.
        OSError: it cannot be told: links that lead to themselves, a name that is too long.
    """
    try:
        mode = os.stat(path).st_mode
    except FileNotFoundError:
        return  # a link to nowhere gives way to the file
    to_open_file = path.is_symlink() and os.readlink(path).startswith("/proc/")
    if to_open_file or not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        raise UnwrittenError(f"cannot write {path}: a pipe, a device or an open file has this name")


def check_new_folder(path: str | os.PathLike[str]) -> None:
    """Refuse, before any work, a folder for results whose name is taken, if only by a dangling link.

    Raises:
        UnwrittenError: the name is taken, or no folder can be made there.
    """
    if os.path.lexists(path):
        raise UnwrittenError(f"{path} exists already; choose another folder for the results")
    check_writable(path)


def atomic_write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write ``text`` as UTF-8 in one step; errors as in ``atomic_write_bytes``.

    What UTF-8 cannot say, such as names of files that are no text, appears as its code.
    """
    atomic_write_bytes(path, text.encode("utf-8", errors="backslashreplace"))


def atomic_write_json(path: str | os.PathLike[str], data: Any) -> None:
    """Write ``data`` as indented JSON; NaN and infinity are refused with ``UnwrittenError``."""
    try:
        text = json.dumps(data, indent=2, allow_nan=False)
    except ValueError as error:
        raise UnwrittenError(f"cannot write {path}: {error}") from error
    atomic_write_text(path, text + "\n")


@contextmanager
def atomic_directory(path: str | os.PathLike[str]) -> Generator[Path, None, None]:
    """Yield a temporary folder that becomes ``path`` only if the block ends without an error.

    An empty folder ``path``, such as that of ``reserved_directory``, is replaced. What processes that were
    killed have left unfinished beside ``path`` is removed.

    Raises:
        UnwrittenError: the disk refuses, or something else is at ``path``, which is kept: the sentence says
            beside it where the new folder is.
    """
    target = _place(path)
    temporary = held = None
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        temporary, held = _begin_directory(target)
        yield temporary
        os.chmod(temporary, 0o755)
        _name_directory(temporary, target)
    except OSError as error:
        raise UnwrittenError(f"cannot write {target}: {error.strerror or error}") from error
    finally:
        if temporary is not None:
            _remove(temporary)
        _unlock(held)


def default_folder(parent: Path = Path("runs"), prefix: str = "race") -> Path:
    """``runs/race-<date>-<time>``; a number is added where that is taken."""
    stamp = datetime.now().strftime("%Y%m%d-%H%M%S")
    return next(path for path in numbered(parent / f"{prefix}-{stamp}") if not path.exists())


def numbered(path: Path, suffix: str = "") -> Generator[Path, None, None]:
    """``path``, then what stands beside it where that is taken: with 2 to 999 before its ``suffix``."""
    yield path
    stem = path.name.removesuffix(suffix)
    for count in range(2, 1000):
        yield path.with_name(f"{stem}-{count}{suffix}")


@contextmanager
def reserved_directory(path: str | os.PathLike[str]) -> Generator[Path, None, None]:
    """Hold a folder's name, as an empty folder, while what will fill it is worked out.

    Of two that ask for the same name at the same time only one gets it. An error in the block removes the
    folder, unless it was there before or something was put into it. An empty folder that nobody holds, such
    as a process that was killed leaves, counts as free (not on Windows).

    Raises:
        UnwrittenError: the folder exists already, or the disk refuses.
    """
    target = _place(path)
    was_there = os.path.lexists(target)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        held = _reserve(target)
    except FileExistsError as error:
        raise UnwrittenError(f"{target} exists already; choose another folder for the results") from error
    except OSError as error:
        raise UnwrittenError(f"cannot write {target}: {error.strerror or error}") from error
    try:
        yield target
    except BaseException:
        if not was_there:
            with suppress(OSError):
                target.rmdir()
        raise
    finally:
        _unlock(held)


def _reserve(target: Path) -> int | None:
    """Make and hold a folder, or hold an empty one that nobody holds; else ``FileExistsError``."""
    beside = _lock(target.parent, wait=True)  # nobody takes what another one has made and not held yet
    try:
        try:
            target.mkdir()
        except FileExistsError:
            plain = target.is_dir() and not target.is_symlink()
            held = _lock(target, wait=False) if plain and not any(target.iterdir()) else None
            if held is None:
                raise
            return held
        return _lock(target, wait=False)
    finally:
        _unlock(beside)


def _lock(folder: Path, *, wait: bool) -> int | None:
    """Hold a folder until the returned handle is closed or the process ends; None if another one holds it."""
    if sys.platform == "win32":  # no such locks here: nobody knows whether somebody holds it
        return None
    handle = os.open(folder, os.O_RDONLY)
    if _hold(handle, wait=wait):
        return handle
    os.close(handle)
    return None


def _hold(handle: int, *, wait: bool) -> bool:
    """Whether an open file or folder is now held by this process, until it is closed."""
    if sys.platform == "win32":
        return False
    import fcntl

    try:
        fcntl.flock(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    except OSError:
        return False
    return True


def _unlock(handle: int | None) -> None:
    if handle is not None:
        os.close(handle)


def _begin_directory(target: Path) -> tuple[Path, int | None]:
    """A new folder beside ``target``, held; first those go whose process was killed before it could."""
    beside = _lock(target.parent, wait=True)
    try:
        for folder in target.parent.glob(f".*{_UNFINISHED}"):
            held = _lock(folder, wait=False) if _is_left(folder) else None
            if held is not None:
                shutil.rmtree(folder, ignore_errors=True)
                os.close(held)
        made = Path(tempfile.mkdtemp(dir=target.parent, prefix=".", suffix=_UNFINISHED))
        place = made.with_name(f".{made.stat().st_ino:x}-{secrets.token_hex(4)}{_UNFINISHED}")
        os.rename(made, place)
        return place, _lock(place, wait=False)
    finally:
        _unlock(beside)


def _is_left(folder: Path) -> bool:
    """Whether a folder is one that ``_begin_directory`` made.

    Its name tells the number that the disk gave to it. A copy, or a folder of somebody else that bears such
    a name, has another one.
    """
    named = _LEFT_FOLDER.fullmatch(folder.name)
    try:
        status = folder.lstat()
    except FileNotFoundError:  # it has just got its name
        return False
    return named is not None and stat.S_ISDIR(status.st_mode) and int(named[1], 16) == status.st_ino


def _name_directory(temporary: Path, target: Path) -> None:
    """Give ``temporary`` the name ``target``; what somebody has put there meanwhile stays."""
    kept = next((place for place in numbered(target) if _named(temporary, place)), None)
    if kept is None:
        raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(target))
    if kept != target:
        raise UnwrittenError(f"something else is at {target} now: {kept} is what belongs there")


def _named(temporary: Path, target: Path) -> bool:
    """Whether a folder got a name: in one step, whose place only an empty folder gives up."""
    try:
        if sys.platform == "win32" and target.is_dir():
            target.rmdir()
        os.replace(temporary, target)
    except OSError as error:
        if error.errno not in _TAKEN:
            raise
        return False
    return True


def _remove(folder: Path) -> None:
    """Delete a folder with its content, or a link to a folder; do nothing if it does not exist."""
    if folder.is_symlink():
        folder.unlink()
    else:
        shutil.rmtree(folder, ignore_errors=True)
