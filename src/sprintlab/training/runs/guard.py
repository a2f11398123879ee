"""A run's folder belongs to one training at a time, and a training asked to stop ends between iterations."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

from sprintlab.core.errors import SprintlabError, UnwrittenError
from sprintlab.core.signals import handled_by, terminations

LOCK_NAME = ".lock"


@contextmanager
def exclusive(folder: Path) -> Iterator[None]:
    """Hold a run's folder; the system lets go of it even if the process is killed.

    The file ``.lock`` in it holds the number of the process. Windows has no such lock: nothing is held there.

    Raises:
        SprintlabError: another process trains in this folder, or it cannot be made.
    """
    if sys.platform == "win32":
        yield
        return
    import fcntl

    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = (folder / LOCK_NAME).open("a+")
    except OSError as error:
        raise UnwrittenError(f"cannot write {folder / LOCK_NAME}: {error.strerror or error}") from error
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            lock.seek(0)
            owner = lock.read().strip() or "unknown"
            raise SprintlabError(f"another process trains in {folder}: process {owner}") from error
        lock.truncate(0)
        lock.write(f"{os.getpid()}\n")
        lock.flush()
        yield


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
