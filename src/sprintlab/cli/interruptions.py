"""Ctrl-C and termination signals, counted instead of raised: what runs a robot ends in good order."""

from __future__ import annotations

import signal
from collections.abc import Callable, Generator
from contextlib import contextmanager


@contextmanager
def counted_interruptions() -> Generator[Callable[[], int]]:
    """Yield a function that tells how many Ctrl-C and termination signals have come."""
    received: list[int] = []
    kinds = (signal.SIGINT, signal.SIGTERM)
    before = {kind: signal.signal(kind, lambda number, _: received.append(number)) for kind in kinds}
    try:
        yield lambda: len(received)
    finally:
        for kind, handler in before.items():
            signal.signal(kind, handler)
