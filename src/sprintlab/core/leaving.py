"""Work at a process's end that may take longer than anybody wants to wait, such as closing a connection."""

from __future__ import annotations

import threading
from collections.abc import Callable

_unfinished: list[threading.Thread] = []


def leave(work: Callable[[], None], patience: float) -> None:
    """Do some work, and go on without it after ``patience`` [s]: then only the process's end waits for it."""
    thread = threading.Thread(target=work)
    thread.start()
    thread.join(patience)
    if thread.is_alive():
        _unfinished.append(thread)


def unfinished() -> list[threading.Thread]:
    """What was gone on without, and has not ended."""
    return [thread for thread in _unfinished if thread.is_alive()]
