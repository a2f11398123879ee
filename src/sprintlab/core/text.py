"""Numbers as text."""

from __future__ import annotations

import math


def number(value: float, digits: int = 2) -> str:
    """A number with so many digits behind the point, never ``-0``; a dash where it is not finite."""
    return f"{round(value, digits) + 0.0:.{digits}f}" if math.isfinite(value) else "-"
