"""The clock of the policy: at its own rate, at another one, or unsteady."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from sprintlab.control import POLICY_RATE_HZ
from sprintlab.core.checks import check_range


@dataclass(frozen=True, kw_only=True)
class PolicyClock:
    """When the policy is asked for its next action.

    The policy does not know: its filters and its history go on as if every period were 20 ms.

    Attributes:
        rate: mean rate [Hz].
        jitter: half-width of the uniform draw of each period, as a share of the period, 0 to 0.5.

    Raises:
        InvalidValueError: a field is out of range.
    """

    rate: float = POLICY_RATE_HZ
    jitter: float = 0.0

    def __post_init__(self) -> None:
        check_range("clock.rate", self.rate, 10.0, 250.0, "Hz")
        check_range("clock.jitter", self.jitter, 0.0, 0.5)

    def __str__(self) -> str:
        return f"{self.rate:g} Hz" + (f" ± {100 * self.jitter:g} % each period" if self.jitter else "")

    def periods(self, motor_rate: float, seed: int) -> Iterator[int]:
        """Motor steps from each action to the next, without end.

        Ticks fall on motor steps; what is rounded away at one tick is made up for at the next.

        Args:
            motor_rate: rate of the motor loop [Hz].
            seed: decides the jitter.
        """
        random = np.random.default_rng((seed, 2))
        due, passed = 0.0, 0
        while True:
            due += motor_rate / self.rate * (1.0 + self.jitter * random.uniform(-1.0, 1.0))
            steps = max(1, round(due) - passed)
            passed += steps
            yield steps


CLOCKS = (
    PolicyClock(),
    PolicyClock(rate=48.0),
    PolicyClock(rate=52.0),
    PolicyClock(jitter=0.1),
)
"""The policy's own clock, a slower and a faster one, and an unsteady one."""


def followed_share(clocks: Sequence[PolicyClock], stride_frequencies: Sequence[float]) -> float:
    """How much of a change of the clock's rate the stride frequency follows.

    1: a stride always takes the same number of policy steps; 0: it always takes the same time. The slope of
    a straight line through the logarithms, over the clocks without jitter.

    Returns:
        ``nan`` with fewer than two rates at which there is a stride.
    """
    points = [
        (math.log(clock.rate), math.log(frequency))
        for clock, frequency in zip(clocks, stride_frequencies, strict=True)
        if clock.jitter == 0.0 and frequency > 0.0
    ]
    if len({rate for rate, _ in points}) < 2:
        return math.nan
    rates, frequencies = np.array(points).T
    centred = rates - rates.mean()
    return float(centred @ frequencies / (centred @ centred))
