"""What takes long: whom to tell, and scripts whose processes read them once more and must not start over."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable

Progress = Callable[[str, float | None], None]
"""Told what is being done, and the share done: 0 to 1, ``None`` where it is not known."""


def leave_to_the_parent() -> None:
    """End this process quietly if it is a worker that is still reading its parent's script.

    A script without ``if __name__ == "__main__":`` calls the same function again in every worker; the parent
    then says what is missing (``evaluation.pool``).

    Raises:
        SystemExit: this is such a worker.
    """
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        raise SystemExit(1)
