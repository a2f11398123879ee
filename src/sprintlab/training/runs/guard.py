"""A training that is asked to stop ends between two iterations."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from sprintlab.core.signals import handled_by, terminations


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
