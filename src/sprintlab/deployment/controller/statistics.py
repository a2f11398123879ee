"""How long things took, for as long as the loop runs, in a fixed amount of memory."""

from __future__ import annotations

import numpy as np

PERCENTILES = (50.0, 90.0, 99.0, 99.9)
_BIN = 1e-6  # s
_BINS = 100_000  # up to 0.1 s; what is longer counts in the last bin


class LatencyHistogram:
    """Durations counted in bins of one microsecond.

    Attributes:
        longest: the longest [s].
    """

    def __init__(self) -> None:
        self.longest = 0.0
        self._bins = np.zeros(_BINS, dtype=np.int64)

    def add(self, duration: float) -> None:
        """Take one duration [s]; negative ones count as zero."""
        self.longest = max(self.longest, duration)
        self._bins[min(max(int(duration / _BIN), 0), _BINS - 1)] += 1

    def to_dict(self) -> dict[str, float | int | None]:
        """Count, percentiles and maximum in microseconds; JSON form, None where nothing was counted."""
        reached = np.cumsum(self._bins)
        count = int(reached[-1])
        names = [f"p{percent:g}" for percent in PERCENTILES]
        if count == 0:
            return {"count": 0, **dict.fromkeys((*names, "max"))}
        ranks = np.ceil(count * np.array(PERCENTILES) / 100.0)
        edges = np.minimum((np.searchsorted(reached, ranks) + 1) * _BIN, self.longest)  # of the bins
        values = [round(1e6 * float(value), 1) for value in (*edges, self.longest)]
        return {"count": count, **dict(zip((*names, "max"), values, strict=True))}
