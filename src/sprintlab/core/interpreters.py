"""Python processes that this package starts, which run nothing of the folder that they are started in."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path

SAFE_PATH = "PYTHONSAFEPATH"
"""Variable of the environment that keeps an interpreter from looking for modules where it was started."""


def new_interpreter() -> list[str]:
    """How to start Python for ``-m`` or ``-c``, which look in the working folder first (3.10 always does)."""
    return [sys.executable, *(["-P"] if sys.version_info >= (3, 11) else [])]


def command_line() -> str:
    """The command of this process as it was typed, for reports, logs and policies."""
    name = Path(sys.argv[0]).name or "python"
    return shlex.join(["sprintlab" if name == "__main__.py" else name, *sys.argv[1:]])
