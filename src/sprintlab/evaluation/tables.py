"""Mean and spread over seeds, as text for any table."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, kw_only=True)
class Spread:
    """Mean and sample standard deviation over the seeds that have a value.

    Attributes:
        mean: ``nan`` without a value.
        deviation: ``nan`` with fewer than two values.
    """

    mean: float
    deviation: float

    def text(self, digits: int = 2) -> str:
        """``mean ± deviation``, a dash where it is not defined."""
        if not math.isfinite(self.mean):
            return "-"
        spread = f" ± {self.deviation:.{digits}f}" if math.isfinite(self.deviation) else ""
        return f"{self.mean:.{digits}f}{spread}"


def spread(values: Sequence[float]) -> Spread:
    """Mean and sample standard deviation of the values that are finite."""
    known = np.array([value for value in values if math.isfinite(value)])
    return Spread(
        mean=float(known.mean()) if known.size else math.nan,
        deviation=float(known.std(ddof=1)) if known.size > 1 else math.nan,
    )
