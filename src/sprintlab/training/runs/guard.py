"""A run's folder belongs to one training at a time, and a training asked to stop ends between iterations."""

from __future__ import annotations

import os
import re
import signal
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import IO

from sprintlab.core.errors import SprintlabError
from sprintlab.core.signals import handled_by, terminations

LOCK_NAME = ".lock"


@contextmanager
def exclusive(folder: Path, wait: bool = False) -> Iterator[None]:
    """Hold a run's folder; the system lets go of it even if the process is killed.

    The file ``.lock`` in it holds the number of the process. Windows has no such lock: nothing is held there.

    Args:
        folder: of the run; made if it is not there.
        wait: until another process lets go, instead of refusing.

    Raises:
        SprintlabError: another process trains in this folder, or it cannot be made, or something else bears
            the name ``.lock`` there.
    """
    if sys.platform == "win32":
        yield
        return
    import fcntl

    with _opened(folder) as handle:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            owner = _noted(handle) or "unknown"
            raise SprintlabError(f"another process trains in {folder}: process {owner}") from error
        if _noted(handle) is None:
            raise SprintlabError(
                f"{folder / LOCK_NAME} is no file of sprintlab, and its name is needed: move it away"
            )
        os.ftruncate(handle.fileno(), 0)
        os.pwrite(handle.fileno(), f"{os.getpid()}\n".encode(), 0)
        yield


def _opened(folder: Path) -> IO[bytes]:
    """The lock of a folder; a link in its place is not followed, it may lead to somebody's file."""
    path = folder / LOCK_NAME
    try:
        folder.mkdir(parents=True, exist_ok=True)
        flags = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
        return open(os.open(path, flags, 0o644), "rb+", buffering=0)
    except OSError as error:
        reason = "it is a link" if path.is_symlink() else error.strerror or error
        raise SprintlabError(f"cannot write {path}: {reason}") from error


def _noted(handle: IO[bytes]) -> str | None:
    """The number of the process that last held a lock, empty where none has; None if this is no lock."""
    if not stat.S_ISREG(os.fstat(handle.fileno()).st_mode):
        return None
    found = re.fullmatch(rb"(\d{0,20})\n?", os.pread(handle.fileno(), 32, 0))
    return found[1].decode() if found else None


class StopRequest:
    """What Ctrl-C, SIGTERM and a hangup (a closed terminal) become: a wish to stop.

    It is read between two iterations. A second Ctrl-C interrupts at once, without saving.
    """

    def __init__(self) -> None:
        self.signal: int | None = None

    def __bool__(self) -> bool:
        return self.signal is not None

    @contextmanager
    def listening(self) -> Iterator[StopRequest]:
        """Catch them inside the block; outside the main thread signals stay as they are."""
        with handled_by(self._note, [signal.SIGINT, *terminations()]):
            yield self

    def _note(self, number: int, _frame: FrameType | None) -> None:
        if self.signal is not None and number == signal.SIGINT:
            raise KeyboardInterrupt
        self.signal = number

    def leave(self) -> None:
        """End as the signal wants, if one has come.

        Raises:
            KeyboardInterrupt: it was Ctrl-C; ``SystemExit`` with 128 and its number for another one.
        """
        if self.signal == signal.SIGINT:
            raise KeyboardInterrupt
        if self.signal is not None:
            raise SystemExit(128 + self.signal)
