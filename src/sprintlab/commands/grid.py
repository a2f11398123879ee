"""Grids over forward speed and yaw rate, from whose bins targets are drawn, vectorized.

``SpeedGrid`` is the geometry. ``CommandGrid`` is the grid curriculum of Margolis et al. 2022: every bin has a
weight; targets are drawn from bins in proportion. A robot that holds its target when the target's time is up
makes its bin and the neighbours likelier. Weights never fall. The grid decides where targets lie; a schedule
(``AdaptiveSchedule``) decides how the command moves to them. ``commands.curricula`` has other rules.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from sprintlab.control.arrays import Array, clip, namespace
from sprintlab.core.checks import check_positive, check_range
from sprintlab.core.errors import InvalidValueError

_MOST_BINS = 1000  # each way, by default 32 and 5: a file may ask for all memory there is


class GridBins(NamedTuple):
    """Bins of ``n`` targets: rows and columns of the grid, whole numbers ``(n,)``."""

    row: Array
    column: Array


class TargetOutcome(NamedTuple):
    """How ``n`` robots do on their targets; a grid learns from those that are due or failed."""

    speed: Array  # target [m/s] (n,)
    yaw_rate: Array  # commanded [rad/s] (n,)
    speed_error: Array  # error of the speed against the target now [m/s] (n,)
    yaw_error: Array  # error of the yaw rate against the command now [rad/s] (n,)
    tracking: Array
    """``exp(-error^2)`` of speed and yaw rate, mean over the target's whole time; what is left of that time
    after a fall counts as zero ``(n, 2)``."""
    due: Array  # the target's time is up and the robot stands (n,)
    failed: Array  # the robot fell (n,)


@dataclass(frozen=True, kw_only=True)
class SpeedGrid:
    """Geometry of a grid."""

    speed: tuple[float, float] = (-2.0, 14.0)  # lowest and highest speed [m/s]
    speed_bin: float = 0.5  # height of a bin [m/s]
    yaw_limit: float = 1.0  # greatest yaw rate either way [rad/s]
    yaw_bins: int = 5  # columns

    def __post_init__(self) -> None:
        check_positive("speed_bin", self.speed_bin, "m/s")
        check_positive("yaw_limit", self.yaw_limit, "rad/s")
        if not self.speed[0] + self.speed_bin <= self.speed[1]:
            raise InvalidValueError("speed", self.speed, "a pair (lowest, highest) at least one bin apart")
        check_range("yaw_bins", self.yaw_bins, 1, _MOST_BINS)
        rows = (self.speed[1] - self.speed[0]) / self.speed_bin
        if not 0.5 < rows <= _MOST_BINS:  # none, where the bin is lost beside a speed in rounding
            allowed = f"at least one and at most {_MOST_BINS} bins between the speeds"
            raise InvalidValueError("speed_bin", self.speed_bin, allowed)

    @property
    def rows(self) -> int:
        """Bins along the speed."""
        return round((self.speed[1] - self.speed[0]) / self.speed_bin)

    @property
    def yaw_bin(self) -> float:
        """Width of a bin [rad/s]."""
        return 2.0 * self.yaw_limit / self.yaw_bins

    def middle_speeds(self, like: Array) -> Array:
        """Speed in the middle of each row [m/s] ``(rows,)``, in the type and on the device of ``like``."""
        xp = namespace(like)
        steps = xp.arange(self.rows, dtype=like.dtype, device=like.device)
        return self.speed[0] + (steps + 0.5) * self.speed_bin

    def probabilities(self, weights: Array) -> Array:
        """How likely each bin is, up to a factor ``(rows, columns)``."""
        return weights

    def bins(self, speed: Array, yaw_rate: Array) -> GridBins:
        """The bins in which targets ``(n,)`` lie; those outside count to the nearest."""
        xp = namespace(speed)
        row = xp.floor((speed - self.speed[0]) / self.speed_bin)
        column = xp.floor((yaw_rate + self.yaw_limit) / self.yaw_bin)
        whole = xp.int64
        return GridBins(
            xp.astype(clip(row, 0.0, self.rows - 1.0), whole),
            xp.astype(clip(column, 0.0, self.yaw_bins - 1.0), whole),
        )

    def draw(
        self, weights: Array, random: Array, lower: Array | float, upper: Array | float
    ) -> tuple[Array, Array]:
        """Targets from the bins whose middle lies in ``[lower, upper]``, in proportion to their weights.

        Args:
            weights: what ``initial_weights`` and ``update`` return.
            random: uniform in [0, 1) ``(n, 3)``: bin, place along the speed, place along the yaw rate.
            lower: bottom of the allowed speeds [m/s].
            upper: top of the allowed speeds [m/s].

        Returns:
            Speeds [m/s] and yaw rates [rad/s], each ``(n,)``.
        """
        weights = self.probabilities(weights)
        xp = namespace(weights)
        middle = self.middle_speeds(weights)
        inside = xp.astype((middle >= lower) & (middle <= upper), weights.dtype)
        cumulative = xp.cumulative_sum(xp.reshape(weights * inside[:, None], (-1,)))
        chosen = xp.searchsorted(cumulative, random[:, 0] * cumulative[-1], side="right")
        chosen = clip(chosen, 0, self.rows * self.yaw_bins - 1)
        row = xp.astype(chosen // self.yaw_bins, weights.dtype)
        column = xp.astype(chosen % self.yaw_bins, weights.dtype)
        return (
            self.speed[0] + (row + random[:, 1]) * self.speed_bin,
            -self.yaw_limit + (column + random[:, 2]) * self.yaw_bin,
        )

    def totals(self, bins: GridBins, values: Array) -> Array:
        """Sum of the values ``(n,)`` that fall into each bin ``(rows, columns)``."""
        xp = namespace(values)
        rows = bins.row[:, None] == xp.arange(self.rows, device=values.device)
        columns = bins.column[:, None] == xp.arange(self.yaw_bins, device=values.device)
        weighted = xp.astype(rows, values.dtype) * values[:, None]
        return xp.matmul(xp.matrix_transpose(weighted), xp.astype(columns, values.dtype))


@dataclass(frozen=True, kw_only=True)
class CommandGrid(SpeedGrid):
    """The grid curriculum's rule."""

    start: float = 1.0  # bins whose middle is no faster than this, either way, are open at the start [m/s]
    gain: float = 0.2  # weight that a success adds to the bin and to each of its eight neighbours
    linear_success: float = 0.8  # a target counts as held when exp(-(v - v*)^2) exceeds this
    angular_success: float = 0.5  # the same of the yaw rate

    def __post_init__(self) -> None:
        super().__post_init__()
        check_positive("start", self.start, "m/s")
        for name in ("gain", "linear_success", "angular_success"):
            check_range(name, getattr(self, name), 0.0, 1.0)

    def initial_weights(self, like: Array) -> Array:
        """One for the slow bins, nothing for the others ``(rows, columns)``."""
        xp = namespace(like)
        slow = xp.astype(xp.abs(self.middle_speeds(like)) < self.start, like.dtype)
        return xp.broadcast_to(slow[:, None], (self.rows, self.yaw_bins)) + 0.0

    def held(self, speed_error: Array, yaw_error: Array) -> Array:
        """Whether errors [m/s], [rad/s] ``(n,)`` count as success: both kernels above their thresholds."""
        xp = namespace(speed_error)
        linear = xp.exp(-(speed_error**2)) > self.linear_success
        return linear & (xp.exp(-(yaw_error**2)) > self.angular_success)

    def update(self, weights: Array, outcome: TargetOutcome) -> Array:
        """The weights one policy step later: targets that are held when their time is up open their bins."""
        held = self.held(outcome.speed_error, outcome.yaw_error)
        return self.learn(weights, self.bins(outcome.speed, outcome.yaw_rate), outcome.due & held)

    def learn(self, weights: Array, bins: GridBins, success: Array) -> Array:
        """Weights after the successes ``(n,)`` of targets in ``bins``: bins and neighbours gain, up to 1.

        However many robots succeed in a bin at once, it gains once: their number does not matter.
        """
        xp = namespace(weights)
        rows = xp.abs(bins.row[:, None] - xp.arange(self.rows, device=weights.device))
        columns = xp.abs(bins.column[:, None] - xp.arange(self.yaw_bins, device=weights.device))
        gained = xp.zeros_like(weights)
        for reach in (0, 1):
            near_row = xp.astype((rows <= reach) & success[:, None], weights.dtype)
            near_column = xp.astype(columns <= reach, weights.dtype)
            near = xp.matmul(xp.matrix_transpose(near_row), near_column) > 0.0
            gained = gained + self.gain * xp.astype(near, weights.dtype)
        return clip(weights + gained, 0.0, 1.0)
