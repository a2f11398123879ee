"""What a few seeds say: interquartile mean, bootstrap interval, probability of improvement.

The measures are those of Agarwal et al., "Deep Reinforcement Learning at the Edge of the Statistical
Precipice" (NeurIPS 2021); SciPy computes them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sprintlab.core.text import number

CONFIDENCE = 0.95
RESAMPLES = 2000


@dataclass(frozen=True, kw_only=True)
class Interval:
    """An estimate and its 95 % bootstrap interval; all ``nan`` without a value.

    Attributes:
        center: the estimate.
        low: lower end; ``nan`` with fewer than two values.
        high: upper end, likewise.
    """

    center: float
    low: float = math.nan
    high: float = math.nan

    def text(self, digits: int = 2) -> str:
        """``center [low, high]``, a dash where it is not defined."""
        if not math.isfinite(self.center):
            return "-"
        known = filter(math.isfinite, (self.center, self.low, self.high))
        center, *ends = (number(value, digits) for value in known)
        return f"{center} [{', '.join(ends)}]" if ends else center


def interquartile_mean(values: Sequence[float]) -> Interval:
    """Mean of the middle half of the finite values; of three, of all of them.

    The interval is the percentile bootstrap's over the seeds; the draws are always the same.
    """
    known = np.array([value for value in values if math.isfinite(value)])
    if known.size == 0:
        return Interval(center=math.nan)
    center = float(_middle(known))
    return Interval(center=center) if known.size < 2 else _bootstrapped(center, (known,), _middle)


def improvement(ours: Sequence[float], theirs: Sequence[float]) -> Interval:
    """Probability that a seed of ours is faster than one of theirs, ties counting half.

    Args:
        ours: speeds of our seeds; one that collapsed counts as 0, not as missing.
        theirs: speeds of the other method's seeds, likewise.
    """
    if not ours or not theirs:
        return Interval(center=math.nan)
    a, b = (np.nan_to_num(np.asarray(group, dtype=float)) for group in (ours, theirs))
    center = float(_faster(a, b))
    return Interval(center=center) if min(a.size, b.size) < 2 else _bootstrapped(center, (a, b), _faster)


def difference(ours: Sequence[float], theirs: Sequence[float]) -> Interval:
    """Interquartile mean of ours minus that of theirs, with its bootstrap interval."""
    if not ours or not theirs:
        return Interval(center=math.nan)
    a, b = np.asarray(ours, dtype=float), np.asarray(theirs, dtype=float)
    center = float(_apart(a, b))
    return Interval(center=center) if min(a.size, b.size) < 2 else _bootstrapped(center, (a, b), _apart)


def _apart(ours: Any, theirs: Any, axis: int = -1) -> Any:
    return _middle(ours, axis=axis) - _middle(theirs, axis=axis)


def _middle(values: Any, axis: int = -1) -> Any:
    from scipy import stats  # takes a second: where it is used

    return stats.trim_mean(values, 0.25, axis=axis)


def _faster(ours: Any, theirs: Any, axis: int = -1) -> Any:
    from scipy import stats

    with np.errstate(divide="ignore", invalid="ignore"):  # raised by the test's p-value, which is not used
        wins = stats.mannwhitneyu(ours, theirs, axis=axis, method="asymptotic").statistic
    return wins / (ours.shape[axis] * theirs.shape[axis])


def _bootstrapped(center: float, samples: tuple[Any, ...], statistic: Callable[..., Any]) -> Interval:
    if all(np.ptp(sample) == 0.0 for sample in samples):
        return Interval(center=center, low=center, high=center)
    from scipy import stats

    found = stats.bootstrap(
        samples,
        statistic,
        n_resamples=RESAMPLES,
        vectorized=True,
        confidence_level=CONFIDENCE,
        method="percentile",
        rng=np.random.default_rng(0),
    ).confidence_interval
    return Interval(center=center, low=float(found.low), high=float(found.high))
