"""How the range of commanded speeds grows, and when the second stage takes over.

Plain Python numbers, updated once per training iteration, which go into the checkpoint.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from sprintlab.control.arrays import Array, namespace


def ranked_speeds(speed: Array, shares: Sequence[float]) -> list[Array]:
    """The speeds [m/s] that these shares of the environments ``(n,)`` do not exceed, as 0-d arrays."""
    ordered = namespace(speed).sort(speed)
    return [ordered[math.ceil(share * speed.shape[0]) - 1] for share in shares]


LOWEST = -2.0
"""The bottom of the range never falls below this [m/s]."""


@dataclass(kw_only=True)
class RangeGrowth:
    """The range ``[lower, upper]`` of commanded speeds: grows while the fastest twentieth keep up.

    A rule that looks at fewer robots, say the fastest 0.1 %, counts those that tumble: the range is then open
    before any robot walks, and small robots never learn to.
    """

    upper: float = 1.0  # top of the range now [m/s]
    increment: float = 0.1  # growth an iteration [m/s]
    share: float = 0.7  # grow while the fastest twentieth are faster than this share of the top [-]

    @property
    def lower(self) -> float:
        """Bottom of the range [m/s]."""
        return max(LOWEST, -max(1.0, self.upper / 3.0))

    def update(self, fast: float, top: float) -> None:
        """Grow by one increment, at most to ``top``, if ``fast``, which a twentieth exceeds [m/s], keeps up.

        The range never shrinks, and a NaN speed does not grow it.
        """
        if fast > self.share * self.upper:
            self.upper = max(self.upper, min(top, self.upper + self.increment))


@dataclass(kw_only=True)
class StageBlend:
    """From stage I to stage II: a weight that ramps from 0 to 1 once and never goes back.

    The ramp begins when the range has reached ``first_top`` and ``earliest_iteration`` iterations have
    passed.
    """

    first_top: float = 6.0  # top of the speed range in stage I [m/s]
    second_top: float = 12.0  # top of the speed range in stage II [m/s]
    earliest_iteration: int = 200  # the ramp starts no sooner
    ramp_iterations: int = 150  # length of the ramp
    iteration: int = 0  # iterations seen
    progress: int = 0  # iterations since the ramp began

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
        self.iteration += 1
        ready = upper >= self.first_top - 1e-9 and self.iteration > self.earliest_iteration
        if self.progress > 0 or ready:
            self.progress = min(self.progress + 1, self.ramp_iterations)
