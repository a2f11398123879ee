"""Curricula of other papers over the same grid of targets: RLvRL's box, LP-ACRL's progress, "after HACL".

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


def softmax(values: Array) -> Array:
    """Positive, sum one, in the shape of ``values``."""
    xp = namespace(values)
    grown = xp.exp(values - xp.max(values))
    return grown / xp.sum(grown)


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

    Attributes:
        temperature: the paper's beta.
        stage_steps: policy steps in a stage.

    Raises:
        InvalidValueError: as ``SpeedGrid``, or a number that is not positive.
    """

    temperature: float = 0.05
    stage_steps: int = 400

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
        chosen = softmax((mean - weights[1]) / self.temperature)
        nothing = xp.zeros_like(total)
        after = xp.stack((chosen, mean, nothing, nothing, nothing))
        return xp.where(ended[None], after, xp.stack((weights[0], weights[1], total, count, steps)))


@dataclass(frozen=True, kw_only=True)
class PredictionGrid(SpeedGrid):
    """After HACL: a model of the reward of each bin, learned online, decides which bins are drawn.

    As in the paper a model predicts the mean reward ``mu(bin)`` and follows the gradient of the mean of
    ``(r - mu)^2``. Its recurrent network is replaced by a linear model on Gaussian bumps, whose parameters
    carry the history, and its unpublished utility by ``4 mu (1 - mu)``: greatest where a target is neither
    mastered nor out of reach. Hence "after HACL". Bins are drawn by ``softmax(utility / temperature)``.

    Attributes:
        width: width of a bump, in bins.
        rate: size of the gradient steps, one a policy step over the bins in which a target ended.
        temperature: temperature of the draw; a higher one draws more evenly.

    Raises:
        InvalidValueError: as ``SpeedGrid``, a number that is not positive, or a rate over one.
    """

    width: float = 1.0
    rate: float = 0.05
    temperature: float = 0.2

    def __post_init__(self) -> None:
        super().__post_init__()
        check_positive("width", self.width)
        check_positive("temperature", self.temperature)
        check_range("rate", self.rate, 1e-6, 1.0)

    def initial_weights(self, like: Array) -> Array:
        """Probability of each bin and parameters of the model ``(2, rows, columns)``: nothing is known."""
        xp = namespace(like)
        empty = xp.zeros((self.rows, self.yaw_bins), dtype=like.dtype, device=like.device)
        return xp.stack((empty + 1.0 / (self.rows * self.yaw_bins), empty + 0.5))

    def probabilities(self, weights: Array) -> Array:
        """How likely each bin is ``(rows, columns)``."""
        return weights[0]

    def predicted(self, parameters: Array) -> Array:
        """The model's mean reward of each bin ``(rows, columns)``."""
        xp = namespace(parameters)
        by_row, by_column = self._bumps(parameters, self.rows), self._bumps(parameters, self.yaw_bins)
        return xp.matmul(xp.matmul(by_row, parameters), xp.matrix_transpose(by_column))

    def update(self, weights: Array, outcome: TargetOutcome) -> Array:
        """The memory one policy step later: a gradient step of the model, and the probabilities after it."""
        xp = namespace(weights)
        finished = xp.astype(outcome.due | outcome.failed, weights.dtype)
        bins = self.bins(outcome.speed, outcome.yaw_rate)
        count = self.totals(bins, finished)
        seen = self.totals(bins, finished * target_score(outcome)) / xp.maximum(count, filled(1.0, count))
        error = (seen - self.predicted(weights[1])) * xp.astype(count > 0.0, weights.dtype)
        by_row, by_column = self._bumps(error, self.rows), self._bumps(error, self.yaw_bins)
        slope = xp.matmul(xp.matmul(xp.matrix_transpose(by_row), error), by_column)
        parameters = weights[1] + self.rate * slope
        mean = self.predicted(parameters)
        return xp.stack((softmax(4.0 * mean * (1.0 - mean) / self.temperature), parameters))

    def _bumps(self, like: Array, count: int) -> Array:
        """Share of each bump in each bin ``(count, count)``; rows sum to one."""
        xp = namespace(like)
        place = xp.arange(count, dtype=like.dtype, device=like.device)
        bump = xp.exp(-0.5 * ((place[:, None] - place) / self.width) ** 2)
        return bump / xp.sum(bump, axis=1, keepdims=True)


Curriculum = CommandGrid | BoxGrid | ProgressGrid | PredictionGrid
"""What ``TargetSampling.grid`` may be."""
