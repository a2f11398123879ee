"""The highest speed at which a stride keeps every limit.

The speed is an unknown of the search like the shape of the stride. From each starting stride, least squares
lower the violations of all limits while a weak pull raises the speed; the pull is then taken back in steps
(a quadratic penalty method), and what is left is checked at its own speed. Each start therefore tells a limit
of its own: their spread says how far the search can be trusted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from sprintlab.core.checks import check_range
from sprintlab.core.constants import GRAVITY
from sprintlab.core.errors import SimulationError
from sprintlab.speed_limit.leg import FloatArray
from sprintlab.speed_limit.runner import Runner
from sprintlab.speed_limit.stride import (
    GROUPS,
    PARAMETERS,
    SHAPES,
    SWING_WAVES,
    evaluate,
    stride_bounds,
    violations,
)

KEPT = 3e-3
"""A stride is possible when nothing is broken by more; ``_MARGIN`` of stride.py is inside it."""
_STEP = 1e-5  # step of the scaled parameters and of the speed, for differences
_EVALUATIONS = 150  # at most, in a local search
_PULLS = (0.05, 0.01, 0.003)  # weights of the pull on the speed, one after the other
_FIRM = 6.0  # m/s between speed and goal at which a pull's weight is meant
_RETREATS = (0.0, 0.001, 0.003, 0.006, 0.01, 0.02)  # shares of the speed given up until a stride is possible
_SHAKES = (0.3, 0.7)  # changes of the best stride, in units of ``_SCALES``
_PACES = (3.4, 5.6)  # speeds to begin at, in roots of g times leg length: horses and cheetahs reach 5 to 6
_SLOW = 0.5  # share of the speed to begin at once more when a start ends nowhere
_DEFAULT_CEILING = 10.0  # in the same unit: where the pull leads when no ceiling is given
_SCALES = np.r_[0.05, 0.03, 0.05, 0.05, 0.05, 0.05, 0.1, 0.1, 0.1, 0.1, 0.1, np.full(2 * SWING_WAVES, 0.15)]


@dataclass(frozen=True, kw_only=True)
class SearchSettings:
    """How hard to look, and which strides count.

    Raises:
        InvalidValueError: a field is out of range.
    """

    starts: int = 6  # random strides to begin from; as many more begin at the best stride so far, shaken
    max_stride: float | None = None  # highest stride frequency that counts [Hz]; None: what the motors allow
    # lowest share of a stride in which a foot is on the ground; None: what the motors allow
    min_duty: float | None = None

    def __post_init__(self) -> None:
        check_range("starts", self.starts, 1, 1000)
        if self.max_stride is not None:
            check_range("max_stride", self.max_stride, 1.1, 16.0, "Hz")
        if self.min_duty is not None:
            check_range("min_duty", self.min_duty, 0.04, 0.5)


@dataclass(frozen=True, kw_only=True)
class Fastest:
    """The fastest possible stride that was found."""

    speed: float  # [m/s]
    parameters: FloatArray  # parameters of the stride ``(PARAMETERS,)`` that proves this speed possible
    bounded: bool = True  # False where the search ended at its ceiling
    # speed that each start came to, in order; 0 where it came to no possible stride [m/s]
    found: tuple[float, ...] = ()

    @property
    def spread(self) -> float:
        """From the best to the third best start [m/s]: what one more run of the search may change."""
        ranked = sorted(self.found, reverse=True)
        return ranked[0] - ranked[min(2, len(ranked) - 1)] if ranked else 0.0


def fastest_stride(
    runner: Runner,
    settings: SearchSettings | None = None,
    *,
    groups: Sequence[str] = GROUPS,
    near: Sequence[Fastest] = (),
    ceiling: float | None = None,
) -> Fastest:
    """The highest speed at which a stride keeps the limits: the best of several climbs.

    Args:
        runner: the robot.
        settings: how hard to look, and bounds on frequency and duty.
        groups: the limits to keep, of ``GROUPS``.
        near: results for similar robots, to begin with.
        ceiling: speed at which to stop looking [m/s]; None: far above what any runner reaches.

    Raises:
        SimulationError: no start came to a possible stride.
    """
    settings = settings or SearchSettings()
    search = _Search(runner, settings, tuple(groups), ceiling)
    best, found = (0.0, np.zeros(PARAMETERS)), []
    for item in near:  # a stride that keeps these limits too is a bound from below, wherever the climbs end
        if item.speed > best[0] and search.keeps(item):
            best = item.speed, item.parameters
    for start, speed in search.starts(near):
        climbed = search.climb(start, speed)
        found.append(climbed[0])
        best = max(best, climbed, key=lambda item: item[0])
    if best[0] == 0.0:
        raise SimulationError("no stride is possible at any speed: the motors cannot carry the robot")
    for shake in search.shakes():
        climbed = search.climb(best[1] + shake, best[0])
        found.append(climbed[0])
        best = max(best, climbed, key=lambda item: item[0])
    top = search.ceiling
    return Fastest(
        speed=best[0], parameters=best[1], bounded=best[0] < top * (1.0 - 1e-6), found=tuple(found)
    )


class _Search:
    """Climbs to the fastest stride that keeps the limits."""

    def __init__(
        self, runner: Runner, settings: SearchSettings, groups: tuple[str, ...], ceiling: float | None
    ) -> None:
        self._runner, self._settings, self._groups = runner, settings, groups
        self._pace = float(np.sqrt(GRAVITY * runner.leg.reach))
        self.ceiling = _DEFAULT_CEILING * self._pace if ceiling is None else ceiling
        lower, upper = stride_bounds(runner, settings.max_stride, settings.min_duty)
        self._lower, self._upper = lower / _SCALES, upper / _SCALES

    def starts(self, near: Sequence[Fastest]) -> Iterator[tuple[FloatArray, float]]:
        """Strides to begin from, with their speeds: known ones, then random ones."""
        for item in near:
            yield item.parameters, min(item.speed, 0.99 * self.ceiling)
        random = np.random.default_rng(0)
        for _ in range(self._settings.starts):
            speed = min(self._pace * random.uniform(*_PACES), 0.99 * self.ceiling)
            yield self._draw(random, speed), speed

    def shakes(self) -> Iterator[FloatArray]:
        """Changes of a known stride, from which to climb again."""
        random = np.random.default_rng(1)
        for index in range(self._settings.starts):
            strength = _SHAKES[index % len(_SHAKES)]
            yield strength * _SCALES * random.standard_normal(PARAMETERS)

    def keeps(self, stride: Fastest) -> bool:
        """Whether a known stride keeps the limits at its own speed, within bounds and below the ceiling."""
        scaled = stride.parameters / _SCALES
        inside = bool(((self._lower <= scaled) & (scaled <= self._upper)).all())
        return (
            inside
            and stride.speed <= self.ceiling
            and float(np.abs(self._residuals(scaled[None], stride.speed)).max()) < KEPT
        )

    def climb(self, start: FloatArray, speed: float) -> tuple[float, FloatArray]:
        """Fastest possible stride uphill of a start: its speed (0: none) and its parameters."""
        for begin in (speed, _SLOW * speed):
            scaled, reached = start / _SCALES, begin
            for pull in _PULLS:
                scaled, reached = self._pulled(scaled, reached, pull)
            for retreat in _RETREATS:
                worst, scaled = self._repaired(scaled, (1.0 - retreat) * reached)
                if worst < KEPT:
                    return (1.0 - retreat) * reached, scaled * _SCALES
        return 0.0, start

    def _draw(self, random: np.random.Generator, speed: float) -> FloatArray:
        """A stride as runners have them: 2.5 to 7 a second, legs swept by 0.3 to 1 leg length."""
        reach = self._runner.leg.reach
        pace = np.sqrt(reach / 0.63)  # periods of similar animals go with the root of their size
        period = random.uniform(0.15, 0.4) * pace
        shapes = {
            "period": period,
            "duty": np.clip(random.uniform(0.3, 1.0) * reach / speed / period, 0.05, 0.5),
            "height": random.uniform(0.7, 0.92) * reach,
            "sweep": random.uniform(-0.15, 0.15) * reach,
            "share": random.uniform(0.3, 0.9),
            "impact": 0.05,
        }
        waves = random.normal(0.0, 0.1, (2, SWING_WAVES))
        waves[1, 0] -= random.uniform(0.2, 1.2)  # bend the knee
        return np.r_[[shapes.get(name, 0.0) for name in SHAPES], waves.ravel()]

    def _pulled(self, scaled: FloatArray, speed: float, pull: float) -> tuple[FloatArray, float]:
        """Least squares on violations and on what is missing to the ceiling: scaled stride and speed."""
        weight = pull * np.sqrt(_FIRM / max(self.ceiling - speed, 0.01 * self.ceiling))

        def residuals(unknown: FloatArray) -> FloatArray:
            missing = weight * (self.ceiling - unknown[-1])
            return np.r_[self._residuals(unknown[None, :-1], unknown[-1])[0], missing]

        def slopes(unknown: FloatArray) -> FloatArray:
            pulled = np.r_[np.zeros(PARAMETERS), -weight]
            return np.vstack((self._slopes(unknown), pulled))

        bounds = np.r_[self._lower, 0.05 * self._pace], np.r_[self._upper, self.ceiling]
        found = _least_squares(residuals, slopes, np.r_[scaled, speed], bounds)[1]
        return found[:-1], float(found[-1])

    def _repaired(self, scaled: FloatArray, speed: float) -> tuple[float, FloatArray]:
        """Least squares on the violations at one speed: the greatest one that is left, and the stride."""
        worst = float(np.abs(self._residuals(scaled[None], speed)).max())
        if worst < KEPT:
            return worst, scaled
        found = _least_squares(
            lambda shape: self._residuals(shape[None], speed)[0],
            lambda shape: self._slopes(np.r_[shape, speed])[:, :-1],
            scaled,
            (self._lower, self._upper),
        )
        return float(np.abs(found[0]).max()), found[1]

    def _residuals(self, scaled: FloatArray, speed: float | FloatArray) -> FloatArray:
        broken = violations(self._runner, evaluate(self._runner, scaled * _SCALES, speed))
        return np.concatenate([broken[name] for name in self._groups], axis=1)

    def _slopes(self, unknown: FloatArray) -> FloatArray:
        """Derivative of the residuals by all parameters and the speed: differences, in one batch."""
        batch = np.tile(unknown, (len(unknown) + 1, 1))
        batch[1:] += _STEP * np.eye(len(unknown))
        residuals = self._residuals(batch[:, :-1], batch[:, -1])
        return (residuals[1:] - residuals[0]).T / _STEP


def _least_squares(
    residuals: Callable[[FloatArray], FloatArray],
    slopes: Callable[[FloatArray], FloatArray],
    start: FloatArray,
    bounds: tuple[FloatArray, FloatArray],
) -> tuple[FloatArray, FloatArray]:
    """Residuals that are left and the unknowns, within bounds."""
    from scipy.optimize import least_squares

    lower, upper = bounds
    result = least_squares(
        residuals,
        np.clip(start, lower + 1e-9, upper - 1e-9),
        jac=slopes,  # pyright: ignore[reportArgumentType]
        bounds=bounds,
        max_nfev=_EVALUATIONS,
        xtol=1e-6,
        ftol=1e-4,
        gtol=1e-12,
    )
    return np.asarray(result.fun), np.asarray(result.x)
