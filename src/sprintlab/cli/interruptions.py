"""Ctrl-C and termination signals, counted instead of raised: what runs a robot ends in good order."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager

from sprintlab.core.errors import SprintlabError
from sprintlab.core.signals import HANGUP, handled_by, terminations

_REPEATED = 1.0  # s
_asked: list[int] = []  # signals that asked a command to end, also those whose exception was lost


@contextmanager
def tidy_termination() -> Generator[None]:
    """Ctrl-C and a termination signal end the block as an exit does: what is half-written is tidied away.

    So does a hangup (a closed terminal), unless that is ignored (``nohup``).

    Of a storm of signals, as of a key that is held, one a second counts: the others would end the tidying.
    """
    last = -_REPEATED

    def leave(number: int, _: object) -> None:
        nonlocal last
        _asked.append(number)
        if (now := time.monotonic()) - last >= _REPEATED:
            last = now
            raise _ending()

    ctrl_c = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    kinds = [signal.SIGINT] if ctrl_c else []
    try:
        with handled_by(leave, kinds + terminations()):
            yield
    except Exception as error:  # a compiled function that is interrupted may say something else
        if not _asked or isinstance(error, SprintlabError):
            raise
        raise _ending() from error
    finally:
        _asked.clear()


def _ending() -> BaseException:
    return KeyboardInterrupt() if _asked[0] == signal.SIGINT else SystemExit(128 + _asked[0])


@contextmanager
def counted_interruptions() -> Generator[Callable[[], int]]:
    """Yield a function that tells how many Ctrl-C and termination signals have come.

    A hangup (a closed terminal, a lost connection) counts too where nothing came before it: shells and
    systems tell of it several times, and of a session's end by a termination signal as well. Such a signal
    is a new request a second after the last. Where a hangup is ignored (``nohup``) it stays so.

    Raises:
        KeyboardInterrupt: Ctrl-C was pressed before and its exception was lost, as in a callback of Python's
            own while modules are imported; ``SystemExit`` likewise: what was asked to end does not begin.
    """
    received: list[int] = []
    last = -_REPEATED

    def note(number: int, _: object) -> None:
        nonlocal last
        now = time.monotonic()
        same = number != signal.SIGINT and (number == HANGUP or now - last < _REPEATED)
        if not (received and same):
            received.append(number)
            last = now  # of those that counted: who asks again and again is heard

    with handled_by(note, [signal.SIGINT, *terminations()]):
        if _asked:
            raise _ending()
        yield lambda: len(received)
