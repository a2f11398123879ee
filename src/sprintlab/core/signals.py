"""Signals that mean something else for as long as a block runs."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Generator, Iterable
from contextlib import contextmanager
from typing import Any

Handler = Callable[[int, Any], None] | signal.Handlers
HANGUP: signal.Signals | None = getattr(signal, "SIGHUP", None)
"""Hangup: the signal that a closed terminal or a lost connection sends; Windows has none."""


def terminations() -> list[signal.Signals]:
    """What asks a command to end, beside Ctrl-C; no hangup where that is ignored (``nohup``)."""
    if HANGUP is None or signal.getsignal(HANGUP) == signal.SIG_IGN:
        return [signal.SIGTERM]
    return [signal.SIGTERM, HANGUP]


@contextmanager
def handled_by(handler: Handler, kinds: Iterable[int]) -> Generator[None, None, None]:
    """Give signals to ``handler`` inside the block, and to who had them before at its end.

    Outside the main thread, to which signals belong, they stay as they are.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {kind: signal.signal(kind, handler) for kind in kinds}
    try:
        yield
    finally:
        for kind, handler_before in before.items():
            signal.signal(kind, handler_before)
