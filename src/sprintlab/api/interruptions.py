"""Ctrl-C and termination signals: a command tidies up, and what runs a robot counts them instead."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager

from sprintlab.core.signals import HANGUP, handled_by, terminations

_REPEATED = 1.0  # s
_asked: list[int] = []  # signals that asked a command to end, also those whose exception was lost


@contextmanager
def tidy_termination() -> Generator[None]:
    """Ctrl-C, a termination signal or a hangup ends the block as an exit does: temporary files are removed.

    A hangup (a closed terminal) does not where it is ignored (``nohup``).
    """

    def leave(number: int, _: object) -> None:
        _asked.append(number)
        raise _ending()

    ctrl_c = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    kinds = [signal.SIGINT] if ctrl_c else []
    try:
        with handled_by(leave, kinds + terminations()):
            yield
    finally:
        _asked.clear()


def _ending() -> BaseException:
    return KeyboardInterrupt() if _asked[0] == signal.SIGINT else SystemExit(128 + _asked[0])


@contextmanager
def counted_interruptions() -> Generator[Callable[[], int]]:
    """Yield a function that tells how many Ctrl-C and termination signals have come.

    A closed terminal or the end of a session sends several signals, which count once: a hangup counts only
    as the first, a termination signal only if a second has passed since the last one that counted.

    Raises:
        KeyboardInterrupt: Ctrl-C was pressed before and its exception was lost, as in a callback of Python's
            own while modules are imported; ``SystemExit`` after another signal.
    """
    received: list[int] = []
    last = -_REPEATED

    def note(number: int, _: object) -> None:
        nonlocal last
        now = time.monotonic()
        same = number != signal.SIGINT and (number == HANGUP or now - last < _REPEATED)
        if not (received and same):
            received.append(number)
            last = now

    with handled_by(note, [signal.SIGINT, *terminations()]):
        if _asked:
            raise _ending()
        yield lambda: len(received)
