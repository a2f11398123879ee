"""Python processes that this package starts, which run nothing of the folder that they are started in."""

from __future__ import annotations

import sys

SAFE_PATH = "PYTHONSAFEPATH"
"""Variable of the environment that keeps an interpreter from looking for modules where it was started."""


def new_interpreter() -> list[str]:
    """How to start Python for ``-m`` or ``-c``, which look in the working folder first (3.10 always does)."""
    return [sys.executable, *(["-P"] if sys.version_info >= (3, 11) else [])]
