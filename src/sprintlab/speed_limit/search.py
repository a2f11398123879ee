"""The highest speed at which a stride keeps every limit."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from sprintlab.core.checks import check_range
from sprintlab.core.errors import SimulationError
from sprintlab.core.extras import require_package
from sprintlab.speed_limit.leg import GRAVITY, FloatArray
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

Tick = Callable[[], None]

_KEPT = 3e-3  # a stride is possible when nothing is broken by more; ``_MARGIN`` of stride.py is inside it
_STEP = 1e-5  # of the scaled parameters, for differences
_EVALUATIONS = 120  # at most, in a local search
_SHAKE = 0.7  # of a known stride, in units of ``_SCALES``
_GROWTH, _PROBE = 1.25, 1.06
_FASTEST_PACE, _STEPS_DOWN = 7.5, 14  # in roots of g times leg length: horses and cheetahs reach 5 to 6
_SCALES = np.r_[0.05, 0.03, 0.05, 0.05, 0.05, 0.05, 0.1, 0.1, 0.1, 0.1, 0.1, np.full(2 * SWING_WAVES, 0.15)]


@dataclass(frozen=True, kw_only=True)
class SearchSettings:
    """How hard to look.

    Attributes:
        starts: random strides from which a speed is tried before it counts as too fast.
        resolution: relative width of the interval in which the limit is left.
        seed: of the random strides.

    Raises:
        InvalidValueError: a field is out of range.
    """

    starts: int = 6
    resolution: float = 0.004
    seed: int = 0

    def __post_init__(self) -> None:
        check_range("starts", self.starts, 1, 1000)
        check_range("resolution", self.resolution, 1e-4, 0.1)
        check_range("seed", self.seed, 0, 2**32 - 1)


@dataclass(frozen=True, kw_only=True)
class Fastest:
    """The fastest possible stride that was found.

    Attributes:
        speed: [m/s].
        parameters: of the stride ``(PARAMETERS,)``: the witness that this speed is possible in the model.
        bounded: False where the search ended at its ceiling.
    """

    speed: float
    parameters: FloatArray
    bounded: bool = True


def fastest_stride(
    runner: Runner,
    settings: SearchSettings | None = None,
    *,
    groups: Sequence[str] = GROUPS,
    near: Fastest | None = None,
    ceiling: float = 60.0,
    tick: Tick | None = None,
) -> Fastest:
    """The highest speed at which a stride keeps the limits: bracketed from above, then halved.

    Args:
        runner: the robot.
        settings: how hard to look.
        groups: the limits to keep, of ``GROUPS``.
        near: result for a similar robot, to begin with.
        ceiling: speed at which to stop looking [m/s].
        tick: called after each speed that was tried.

    Raises:
        SimulationError: no stride is possible even at walking speed.
        SprintlabError: SciPy, which the extra ``analysis`` brings, is not installed.
    """
    require_package("scipy", extra="analysis", use="the speed limit")
    settings = settings or SearchSettings()
    search = _Search(runner, settings, tuple(groups), tick)
    slow, known = _first_possible(search, near)
    growth = _GROWTH if near is None else _PROBE
    while True:
        slow, known, fast = _ascend(search, slow, known, growth, ceiling)
        if fast is None:
            return Fastest(speed=slow, parameters=known, bounded=False)
        slow, known = _bisect(search, slow, known, fast, settings.resolution)
        # A search can miss a possible stride: what lies a little beyond is looked at once more.
        beyond = search.possible(_PROBE * slow, known)
        if beyond is None:
            return Fastest(speed=slow, parameters=known)
        slow, known = _PROBE * slow, beyond


def _ascend(
    search: _Search, slow: float, known: FloatArray, growth: float, ceiling: float
) -> tuple[float, FloatArray, float | None]:
    """Raise the speed up to the ceiling: the last possible one, its stride, the first too fast."""
    while slow < ceiling:
        higher = min(growth * slow, ceiling)
        found = search.possible(higher, known)
        if found is None:
            return slow, known, higher
        slow, known = higher, found
    return slow, known, None


def _bisect(
    search: _Search, slow: float, known: FloatArray, fast: float, resolution: float
) -> tuple[float, FloatArray]:
    """Halve the interval between a possible speed and one that is too fast."""
    while fast / slow > 1.0 + resolution:
        middle = 0.5 * (slow + fast)
        found = search.possible(middle, known)
        if found is None:
            fast = middle
        else:
            slow, known = middle, found
    return slow, known


def _first_possible(search: _Search, near: Fastest | None) -> tuple[float, FloatArray]:
    """A possible speed and its stride: below a known limit, else down from a speed that no machine reaches.

    From above, since two kinds of gait are possible: the one with long stances, which is found at a slow
    pace, ends far below the one with long flights.
    """
    pace = float(np.sqrt(GRAVITY * search.runner.leg.reach))
    speeds = [pace * _FASTEST_PACE / _GROWTH**step for step in range(_STEPS_DOWN)]
    if near is not None:
        speeds = [near.speed * factor for factor in (1.0, 0.9, 0.75, 0.5)] + speeds[_STEPS_DOWN // 2 :]
    for speed in speeds:
        found = search.possible(speed, None if near is None else near.parameters)
        if found is not None:
            return speed, found
    raise SimulationError("no stride is possible at any speed: the motors cannot carry the robot")


class _Search:
    """Looks for a stride that keeps the limits at a given speed."""

    def __init__(
        self, runner: Runner, settings: SearchSettings, groups: tuple[str, ...], tick: Tick | None
    ) -> None:
        self.runner = runner
        self._settings, self._groups, self._tick = settings, groups, tick
        lower, upper = stride_bounds(runner)
        self._lower, self._upper = lower / _SCALES, upper / _SCALES
        self._closest: tuple[float, FloatArray] | None = None

    def possible(self, speed: float, known: FloatArray | None) -> FloatArray | None:
        """Parameters of a possible stride, or None.

        Local searches begin at ``known``, at the stride that came closest at the last speed that was too
        fast, and at shaken and random strides.
        """
        random = np.random.default_rng(self._settings.seed)
        if self._tick is not None:
            self._tick()
        closest: tuple[float, FloatArray] | None = None
        for start in self._starts(random, speed, known):
            worst, found = self._descend(start, speed)
            if worst < _KEPT:
                return found
            if closest is None or worst < closest[0]:
                closest = worst, found
        self._closest = closest
        return None

    def _starts(
        self, random: np.random.Generator, speed: float, known: FloatArray | None
    ) -> Iterator[FloatArray]:
        if known is not None:
            yield known
        if self._closest is not None:
            yield self._closest[1]
        for index in range(self._settings.starts):
            if known is not None and index % 2 == 0:
                yield known + _SHAKE * _SCALES * random.standard_normal(PARAMETERS)
            else:
                yield self._draw(random, speed)

    def _draw(self, random: np.random.Generator, speed: float) -> FloatArray:
        """A stride as runners have them: 2.5 to 7 a second, legs swept by 0.3 to 1 leg length."""
        reach = self.runner.leg.reach
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

    def _descend(self, start: FloatArray, speed: float) -> tuple[float, FloatArray]:
        """Least squares on the violations: the greatest one that is left, and the stride."""
        from scipy.optimize import least_squares

        inside = np.clip(start / _SCALES, self._lower + 1e-9, self._upper - 1e-9)
        result = least_squares(
            lambda scaled: self._residuals(scaled[None], speed)[0],
            inside,
            jac=lambda scaled: self._slopes(scaled, speed),  # pyright: ignore[reportArgumentType]
            bounds=(self._lower, self._upper),
            max_nfev=_EVALUATIONS,
            xtol=1e-7,
            ftol=5e-4,
            gtol=1e-12,
        )
        return float(np.abs(result.fun).max()), result.x * _SCALES

    def _residuals(self, scaled: FloatArray, speed: float) -> FloatArray:
        broken = violations(self.runner, evaluate(self.runner, scaled * _SCALES, speed))
        return np.concatenate([broken[name] for name in self._groups], axis=1)

    def _slopes(self, scaled: FloatArray, speed: float) -> FloatArray:
        """Derivative of the residuals by differences, all parameters in one batch."""
        batch = np.tile(scaled, (PARAMETERS + 1, 1))
        batch[1:] += _STEP * np.eye(PARAMETERS)
        residuals = self._residuals(batch, speed)
        return (residuals[1:] - residuals[0]).T / _STEP
