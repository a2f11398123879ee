"""Ctrl-C and termination signals, counted instead of raised: what runs a robot ends in good order."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager

_HANGUP: signal.Signals | None = getattr(signal, "SIGHUP", None)  # not on Windows
TERMINATED = 128 + signal.SIGTERM
"""Exit status of a command that was asked to terminate."""


@contextmanager
def tidy_termination() -> Generator[None]:
    """A termination signal ends the block as an exit does: what is half-written is tidied away."""
    if threading.current_thread() is not threading.main_thread():
        yield  # signals belong to the main thread
        return

    def leave(number: int, _: object) -> None:
        raise SystemExit(TERMINATED)

    before = signal.signal(signal.SIGTERM, leave)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


@contextmanager
def counted_interruptions() -> Generator[Callable[[], int]]:
    """Yield a function that tells how many Ctrl-C and termination signals have come.

    A terminal that goes away (a connection that breaks) counts too, once: shells and systems tell of it
    several times. Where that is ignored (``nohup``) it stays so.
    """
    received: list[int] = []

    def note(number: int, _: object) -> None:
        if number not in received or number != _HANGUP:
            received.append(number)

    kinds = [signal.SIGINT, signal.SIGTERM]
    if _HANGUP is not None and signal.getsignal(_HANGUP) != signal.SIG_IGN:
        kinds.append(_HANGUP)
    before = {kind: signal.signal(kind, note) for kind in kinds}
    try:
        yield lambda: len(received)
    finally:
        for kind, handler in before.items():
            signal.signal(kind, handler)
