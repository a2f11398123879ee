"""How the range of commanded speeds grows, and when the second stage takes over.

Plain Python numbers, updated once per training iteration, which go into the checkpoint.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from sprintlab.control.arrays import Array, namespace
from sprintlab.core.checks import check_finite, check_positive, check_range


def ranked_speeds(speed: Array, shares: Sequence[float]) -> list[Array]:
    """The speeds [m/s] that these shares of the environments ``(n,)`` do not exceed, as 0-d arrays."""
    ordered = namespace(speed).sort(speed)
    return [ordered[math.ceil(share * speed.shape[0]) - 1] for share in shares]


LOWEST = -2.0
"""The bottom of the range never falls below this [m/s]."""


@dataclass(kw_only=True)
class RangeGrowth:
    """The range ``[lower, upper]`` of commanded speeds: grows while the fastest are near its top.

    A rule that waits for a share of the environments to be fast stalls; one that looks at the fastest
    0.1 % does not.

    Attributes:
        upper: top of the range now [m/s].
        increment: growth an iteration [m/s].
        margin: grow while the fastest speed exceeds ``upper - margin`` [m/s].

    Raises:
        InvalidValueError: ``upper``, ``increment`` or ``margin`` not positive.
    """

    upper: float = 1.0
    increment: float = 0.1
    margin: float = 0.75

    def __post_init__(self) -> None:
        for field in ("upper", "increment", "margin"):
            check_positive(field, getattr(self, field), "m/s")

    @property
    def lower(self) -> float:
        """Bottom of the range [m/s]."""
        return max(LOWEST, -max(1.0, self.upper / 3.0))

    def update(self, fastest: float, top: float) -> None:
        """Grow by one increment, at most to ``top``, if ``fastest`` [m/s] is near the top of the range.

        The range never shrinks, and a NaN speed does not grow it.
        """
        if fastest > self.upper - self.margin:
            self.upper = max(self.upper, min(top, self.upper + self.increment))


@dataclass(kw_only=True)
class StageBlend:
    """From stage I to stage II: a weight that ramps from 0 to 1 once and never goes back.

    The ramp begins when the range has reached ``first_top`` and ``earliest_iteration`` iterations have
    passed.

    Attributes:
        first_top: top of the speed range in stage I [m/s].
        second_top: top of the speed range in stage II [m/s].
        earliest_iteration: the ramp starts no sooner.
        ramp_iterations: length of the ramp.
        iteration: iterations seen.
        progress: iterations since the ramp began.

    Raises:
        InvalidValueError: tops not positive or in the wrong order, counts negative, no ramp.
    """

    first_top: float = 6.0
    second_top: float = 12.0
    earliest_iteration: int = 200
    ramp_iterations: int = 150
    iteration: int = 0
    progress: int = 0

    def __post_init__(self) -> None:
        check_positive("first_top", self.first_top, "m/s")
        check_range("second_top", self.second_top, self.first_top, math.inf, "m/s")
        for field in ("earliest_iteration", "iteration", "progress"):
            check_range(field, getattr(self, field), 0, math.inf)
        check_range("ramp_iterations", self.ramp_iterations, 1, math.inf)

    @property
    def weight(self) -> float:
        """Share of stage II in the rewards, 0 to 1."""
        return min(1.0, self.progress / self.ramp_iterations)

    @property
    def top(self) -> float:
        """Top to which the range may grow now [m/s]: that of stage II once the ramp has begun."""
        return self.second_top if self.progress > 0 else self.first_top

    def update(self, upper: float) -> None:
        """Count one iteration; ``upper`` is the top of the range reached [m/s]."""
        check_finite("upper", upper)
        self.iteration += 1
        ready = upper >= self.first_top - 1e-9 and self.iteration > self.earliest_iteration
        if self.progress > 0 or ready:
            self.progress = min(self.progress + 1, self.ramp_iterations)
