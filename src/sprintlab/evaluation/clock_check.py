"""The same trials with the policy's clock off its rate: does the speed live on the clock?"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sprintlab.evaluation.audit import AuditThresholds, clock_distance
from sprintlab.evaluation.clock import CLOCKS, PolicyClock, followed_share
from sprintlab.evaluation.pool import TrialPool
from sprintlab.evaluation.protocol import ProtocolSettings
from sprintlab.evaluation.results import TrialResult


@dataclass(frozen=True, kw_only=True)
class ClockTrials:
    """The seeded trials of one v* with one clock.

    Attributes:
        clock: of the policy.
        trials: how many ran.
        completed: how many did not fall and came to rest.
        held_speed: mean over those [m/s]; this and the following are ``nan`` where there is none.
        stride_frequency: median [Hz].
        stride_steps: the same as policy steps a stride.
        clock_distance: of the stride from a whole number of policy steps, median over the trials.
    """

    clock: PolicyClock
    trials: int
    completed: int
    held_speed: float
    stride_frequency: float
    stride_steps: float
    clock_distance: float

    @property
    def locked(self) -> bool:
        """Whether a stride takes a whole number of policy steps, by the limit of the exploit audit."""
        return self.clock_distance < AuditThresholds().clock_distance


@dataclass(frozen=True, kw_only=True)
class ClockCheck:
    """What other clocks make of one policy at one speed.

    Attributes:
        top_speed: v* [m/s].
        clocks: the policy's own first.
    """

    top_speed: float
    clocks: tuple[ClockTrials, ...]

    @property
    def followed(self) -> float:
        """How much of a change of rate the stride follows: 1 all, 0 nothing, as in ``followed_share``."""
        return followed_share(
            [item.clock for item in self.clocks], [item.stride_frequency for item in self.clocks]
        )

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
    """Run the protocol's seeded trials at v* (raw command) with each clock.

    Args:
        pool: policy, robot and processes.
        top_speed: v* [m/s].
        settings: seeds, number of trials, plant.
        own: the trials with the policy's own clock, where they have run.

    Raises:
        SimulationError: as ``run_trial``.
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
    frequency = _over(np.median, frequencies)
    return ClockTrials(
        clock=clock,
        trials=len(trials),
        completed=len(done),
        held_speed=_over(np.mean, (metrics.held_speed for metrics in done)),
        stride_frequency=frequency,
        stride_steps=clock.rate / frequency if frequency else math.nan,
        clock_distance=_over(np.median, (clock_distance(value, clock.rate) for value in frequencies)),
    )


def _over(average: Callable[[list[float]], np.floating], values: Iterable[float]) -> float:
    """An average of what is defined; ``nan`` of nothing."""
    known = [value for value in values if math.isfinite(value)]
    return float(average(known)) if known else math.nan
