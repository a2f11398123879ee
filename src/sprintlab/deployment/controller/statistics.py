"""How long things took, for as long as the loop runs, in a fixed amount of memory."""

from __future__ import annotations

import numpy as np

PERCENTILES = (50.0, 90.0, 99.0, 99.9)
_BIN = 1e-6  # s
_BINS = 100_000  # up to 0.1 s; what is longer counts in the last bin


class LatencyHistogram:
    """Durations counted in bins of one microsecond.

    Attributes:
        count: durations taken.
        longest: the longest [s].
    """

    def __init__(self) -> None:
        self.count = 0
        self.longest = 0.0
        self._bins = np.zeros(_BINS, dtype=np.int64)

    def add(self, duration: float) -> None:
        """Take one duration [s]; negative ones count as zero."""
        self.count += 1
        self.longest = max(self.longest, duration)
        self._bins[min(max(int(duration / _BIN), 0), _BINS - 1)] += 1

    def percentile(self, percent: float) -> float:
        """Upper edge of the bin that holds this percentile [s]; ``nan`` when empty, at most ``longest``."""
        if self.count == 0:
            return float("nan")
        rank = max(1, int(np.ceil(self.count * percent / 100.0)))
        edge = (int(np.searchsorted(np.cumsum(self._bins), rank)) + 1) * _BIN
        return min(edge, self.longest)

    def to_dict(self) -> dict[str, float | int | None]:
        """Count, percentiles and maximum in microseconds; JSON form, None where nothing was counted."""
        values: dict[str, float | int | None] = {"count": self.count}
        for percent in PERCENTILES:
            value = self.percentile(percent)
            values[f"p{percent:g}"] = round(value * 1e6, 1) if self.count else None
        values["max"] = round(self.longest * 1e6, 1) if self.count else None
        return values
