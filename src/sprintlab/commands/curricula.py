"""Curricula of other papers over the same grid of targets: RLvRL's box and LP-ACRL's progress.

Pure functions of arrays without host synchronisation, like all of ``commands``: what a curriculum remembers
is one array, and ``update`` returns the next one. All of them judge a target by its whole time, by
``TargetOutcome.tracking``.
"""

from __future__ import annotations

from dataclasses import dataclass

from sprintlab.commands.grid import CommandGrid, SpeedGrid, TargetOutcome
from sprintlab.control.arrays import Array, filled, namespace
from sprintlab.core.checks import check_positive, check_range


def target_score(outcome: TargetOutcome) -> Array:
    """One number from 0 to 1 a target ``(n,)``: the tracking rewards in the weights of the paper's table."""
    return (outcome.tracking[:, 0] + 0.5 * outcome.tracking[:, 1]) / 1.5


@dataclass(frozen=True, kw_only=True)
class BoxGrid(CommandGrid):
    """RLvRL's box-adaptive grid (Margolis et al. 2022, rapid-locomotion-rl).

    ``CommandGrid``'s rule with the success of its source: the mean of the tracking reward over the target's
    whole time must exceed the thresholds, so that acceleration counts and a fall does not succeed.
    """

    def update(self, weights: Array, outcome: TargetOutcome) -> Array:
        """The weights one policy step later."""
        linear = outcome.tracking[:, 0] > self.linear_success
        success = outcome.due & linear & (outcome.tracking[:, 1] > self.angular_success)
        return self.learn(weights, self.bins(outcome.speed, outcome.yaw_rate), success)


@dataclass(frozen=True, kw_only=True)
class ProgressGrid(SpeedGrid):
    """LP-ACRL: bins are drawn by learning progress, ``softmax((R_j - R_(j-1)) / temperature)``.

    ``R_j(bin)`` is the mean ``target_score`` of stage j. The paper's temperature, stage length and rule for
    an untried bin are not known to us: here they are fields, and such a bin keeps its mean and has
    no progress. All bins are equally likely in the first stage, whose means count from zero.
    """

    temperature: float = 0.05  # the paper's beta
    stage_steps: int = 400  # policy steps in a stage

    def __post_init__(self) -> None:
        super().__post_init__()
        check_positive("temperature", self.temperature)
        check_range("stage_steps", self.stage_steps, 1, 10**7)

    def initial_weights(self, like: Array) -> Array:
        """Probability, mean of the stage before, sum, count, steps done ``(5, rows, columns)``."""
        xp = namespace(like)
        empty = xp.zeros((self.rows, self.yaw_bins), dtype=like.dtype, device=like.device)
        return xp.stack((empty + 1.0 / (self.rows * self.yaw_bins), empty, empty, empty, empty))

    def probabilities(self, weights: Array) -> Array:
        """How likely each bin is ``(rows, columns)``."""
        return weights[0]

    def update(self, weights: Array, outcome: TargetOutcome) -> Array:
        """The memory one policy step later; a stage's end makes the next probabilities."""
        xp = namespace(weights)
        finished = xp.astype(outcome.due | outcome.failed, weights.dtype)
        bins = self.bins(outcome.speed, outcome.yaw_rate)
        total = weights[2] + self.totals(bins, finished * target_score(outcome))
        count, steps = weights[3] + self.totals(bins, finished), weights[4] + 1.0
        mean = xp.where(count > 0.0, total / xp.maximum(count, filled(1.0, count)), weights[1])
        ended = steps >= self.stage_steps
        preferred = (mean - weights[1]) / self.temperature
        grown = xp.exp(preferred - xp.max(preferred))
        nothing = xp.zeros_like(total)
        after = xp.stack((grown / xp.sum(grown), mean, nothing, nothing, nothing))
        return xp.where(ended[None], after, xp.stack((weights[0], weights[1], total, count, steps)))


Curriculum = CommandGrid | BoxGrid | ProgressGrid
"""What ``TargetSampling.grid`` may be."""
