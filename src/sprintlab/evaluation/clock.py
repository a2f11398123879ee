"""The same trials with the policy's clock off its rate: does the speed live on the clock?"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sprintlab.evaluation.audit import CLOCK_DISTANCE, clock_distance
from sprintlab.evaluation.disturbances import PolicyClock
from sprintlab.evaluation.pool import TrialPool
from sprintlab.evaluation.protocol import ProtocolSettings
from sprintlab.evaluation.results import TrialResult

CLOCKS = (PolicyClock(), PolicyClock(rate=48.0), PolicyClock(rate=52.0), PolicyClock(jitter=0.1))
"""The policy's own clock, a slower and a faster one, and an unsteady one."""


@dataclass(frozen=True, kw_only=True)
class ClockTrials:
    """The seeded trials of one v* with one clock; means and medians are ``nan`` where none completed."""

    clock: PolicyClock
    trials: int  # how many ran
    completed: int  # how many did not fall and came to rest
    held_speed: float  # mean over those [m/s]
    stride_frequency: float  # median [Hz]
    clock_distance: float  # from the stride to a whole number of policy steps, median [policy steps]

    @property
    def stride_steps(self) -> float:
        """Policy steps per stride."""
        return self.clock.rate / self.stride_frequency

    @property
    def locked(self) -> bool:
        """Whether a stride takes a whole number of policy steps, by the limit of the exploit audit."""
        return self.clock_distance < CLOCK_DISTANCE


@dataclass(frozen=True, kw_only=True)
class ClockCheck:
    """What other clocks make of one policy at the speed v* [m/s]; the policy's own clock comes first."""

    top_speed: float
    clocks: tuple[ClockTrials, ...]

    @property
    def followed(self) -> float:
        """How much of a change of rate the stride frequency follows.

        1: a stride always takes as many policy steps; 0: as much time. The slope of a straight line through
        the logarithms, over the clocks without jitter; ``nan`` with fewer than two that have a stride.
        """
        steady = [item for item in self.clocks if item.clock.jitter == 0.0 and item.stride_frequency > 0.0]
        if len({item.clock.rate for item in steady}) < 2:
            return math.nan
        rates, frequencies = np.log([(item.clock.rate, item.stride_frequency) for item in steady]).T
        return float(np.polyfit(rates, frequencies, 1)[0])

    @property
    def greatest_loss(self) -> float:
        """Held speed lost with the worst other clock, as a share; ``nan`` where no trial completes there."""
        own, *others = (item.held_speed for item in self.clocks)
        return 1.0 - min(others) / own if all(map(math.isfinite, others)) else math.nan

    @property
    def cost(self) -> float:
        """The same where every trial completes with every clock; else 1, all of it."""
        safe = all(item.completed == item.trials for item in self.clocks)
        return self.greatest_loss if safe and math.isfinite(self.greatest_loss) else 1.0


def check_clock(
    pool: TrialPool,
    top_speed: float,
    *,
    settings: ProtocolSettings | None = None,
    own: Sequence[TrialResult] | None = None,
) -> ClockCheck:
    """Run the protocol's seeded trials at v* (raw command) with each clock; errors as in ``run_trial``.

    Args:
        pool: policy, robot and processes.
        top_speed: v* [m/s].
        settings: seeds, number of trials, plant.
        own: the trials with the policy's own clock, where they have run.
    """
    requests = (settings or ProtocolSettings()).requests(top_speed, self_paced=False)
    found = [] if own is None else [clock_trials(CLOCKS[0], own)]
    for clock in CLOCKS[len(found) :]:
        trials = pool.trials([replace(item, clock=clock, keep_trajectory=False) for item in requests])
        found.append(clock_trials(clock, trials))
    return ClockCheck(top_speed=top_speed, clocks=tuple(found))


def clock_trials(clock: PolicyClock, trials: Sequence[TrialResult]) -> ClockTrials:
    """Summarize trials that ran with one clock."""
    done = [trial.metrics for trial in trials if trial.completed]
    frequencies = [metrics.stride_frequency for metrics in done]
    return ClockTrials(
        clock=clock,
        trials=len(trials),
        completed=len(done),
        held_speed=_of_known(np.mean, [metrics.held_speed for metrics in done]),
        stride_frequency=_of_known(np.median, frequencies),
        clock_distance=_of_known(np.median, (clock_distance(value, clock.rate) for value in frequencies)),
    )


def _of_known(summarize: Callable[[list[float]], Any], values: Iterable[float]) -> float:
    """Mean or median of the finite values; ``nan`` without one."""
    known = [value for value in values if math.isfinite(value)]
    return float(summarize(known)) if known else math.nan
