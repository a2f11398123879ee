"""A run's folder belongs to one training at a time, and a training asked to stop ends between iterations."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

from sprintlab.core.errors import SprintlabError

LOCK_NAME = ".lock"


@contextmanager
def exclusive(folder: Path, wait: bool = False) -> Iterator[None]:
    """Hold a run's folder; the system lets go of it even if the process is killed.

    The file ``.lock`` in it holds the number of the process. Windows has no such lock: nothing is held there.

    Args:
        folder: of the run; made if it is not there.
        wait: until another process lets go, instead of refusing.

    Raises:
        SprintlabError: another process trains in this folder, or the folder cannot be made.
    """
    if sys.platform == "win32":
        yield
        return
    import fcntl

    try:
        folder.mkdir(parents=True, exist_ok=True)
        handle = open(folder / LOCK_NAME, "a+")  # noqa: SIM115  # closed below: closing lets go of the lock
    except OSError as error:
        raise SprintlabError(f"cannot write in {folder}: {error.strerror or error}") from error
    with handle:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise SprintlabError(f"another process trains in {folder}: {lock_owner(folder)}") from error
        handle.truncate(0)
        handle.write(f"{os.getpid()}\n")
        handle.flush()
        yield


def lock_owner(folder: Path) -> str:
    """The process that last held the folder, in words."""
    try:
        return f"process {(folder / LOCK_NAME).read_text().strip() or 'unknown'}"
    except OSError:
        return "process unknown"


class StopRequest:
    """What SIGINT (Ctrl-C) and SIGTERM become: a wish to stop, read between two iterations.

    A second Ctrl-C interrupts at once, without saving.
    """

    def __init__(self) -> None:
        self.signal: int | None = None

    def __bool__(self) -> bool:
        return self.signal is not None

    @contextmanager
    def listening(self) -> Iterator[StopRequest]:
        """Catch both signals inside the block; outside the main thread signals stay as they are."""
        if threading.current_thread() is not threading.main_thread():
            yield self
            return
        caught = (signal.SIGINT, signal.SIGTERM)
        before = {each: signal.signal(each, self._note) for each in caught}
        try:
            yield self
        finally:
            for each, handler in before.items():
                signal.signal(each, handler)

    def _note(self, number: int, _frame: FrameType | None) -> None:
        if self.signal is not None and number == signal.SIGINT:
            raise KeyboardInterrupt
        self.signal = number

    def leave(self) -> None:
        """End as the signal wants: Raises ``KeyboardInterrupt`` or ``SystemExit(143)``; else nothing."""
        if self.signal == signal.SIGINT:
            raise KeyboardInterrupt
        if self.signal is not None:
            raise SystemExit(128 + self.signal)
