"""A training that is asked to stop ends between two iterations."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager

from sprintlab.core.signals import handled_by, terminations


@contextmanager
def stop_requests() -> Iterator[list[int]]:
    """Ctrl-C, SIGTERM and a hangup (a closed terminal) are only noted inside the block, which reads the list.

    A second Ctrl-C interrupts at once, without saving. Outside the main thread signals stay as they are.

    Raises:
        KeyboardInterrupt: at the end, where it was Ctrl-C; ``SystemExit`` with 128 and the number of another.
    """
    asked = list[int]()

    def note(number: int, _: object) -> None:
        if asked and number == signal.SIGINT:
            raise KeyboardInterrupt
        asked.append(number)

    with handled_by(note, [signal.SIGINT, *terminations()]):
        yield asked
        if asked:
            raise KeyboardInterrupt if asked[-1] == signal.SIGINT else SystemExit(128 + asked[-1])
