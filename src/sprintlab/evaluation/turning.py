"""How well a policy turns: achieved over commanded yaw rate, over speeds and yaw rates."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from sprintlab.commands.state import GRAVITY
from sprintlab.core.checks import check_positive, check_range
from sprintlab.core.errors import InvalidValueError
from sprintlab.core.json_values import json_ready
from sprintlab.evaluation.pool import TrialPool
from sprintlab.evaluation.sweep import TURN_WINDOW, Case, Progress, Run, run_cases
from sprintlab.evaluation.trial import Course, TrialRequest
from sprintlab.plant import NOMINAL_TRIAL, BaseState, PlantOptions, TrialSettings

LARGEST_YAW_RATE = 1.0
"""Yaw rates are commanded up to this magnitude [rad/s], in training and here (the paper's range)."""

_STAND, _ACCELERATION = 1.0, 4.0  # [s], [m/s^2]


@dataclass(frozen=True, kw_only=True)
class TurningSettings:
    """What is asked for.

    Raises:
        InvalidValueError: a speed, fraction or duration is out of range.
    """

    speeds: tuple[float, ...] = (0.0, 2.0, 4.0, 6.0, 8.0, 10.0, 12.0)  # commanded, forward [m/s]
    fractions: tuple[float, ...] = (-1.0, -0.5, -0.25, 0.25, 0.5, 1.0)  # of the largest yaw rate
    turn: float = 4.0  # duration of each turn [s]; the last 2 s of it are measured
    plant: PlantOptions = field(default_factory=PlantOptions)
    trial: TrialSettings = NOMINAL_TRIAL

    def __post_init__(self) -> None:
        if not self.speeds or not self.fractions:
            raise InvalidValueError("turning.speeds and turning.fractions", (), "at least one of each")
        for speed in self.speeds:
            check_range("turning.speeds", speed, -5.0, 30.0, "m/s")
        for fraction in self.fractions:
            check_range("turning.fractions", fraction, -1.0, 1.0)
            check_positive("turning.fractions (magnitude)", abs(fraction))
        check_range("turning.turn", self.turn, TURN_WINDOW, 60.0, "s")

    def largest_yaw_rate(self, speed: float) -> float:
        """What friction allows at a speed [rad/s]: ``|v w| <= mu g``, and at most 1 rad/s."""
        return min(LARGEST_YAW_RATE, self.trial.friction * GRAVITY / max(abs(speed), 1e-6))

    def turns(self) -> tuple[Turn, ...]:
        """Every combination, by speed, then by yaw rate."""
        return tuple(
            Turn(speed, fraction * self.largest_yaw_rate(speed), self.turn)
            for speed in self.speeds
            for fraction in self.fractions
        )

    def case(self, turn: Turn) -> Case:
        """One turn as a run of a sweep."""
        speed = max(abs(turn.forward), 0.1)
        request = TrialRequest(top_speed=speed, settings=self.trial, plant=self.plant, keep_trajectory=True)
        return Case(group=f"{turn.forward:g} m/s", request=request, course=turn)


class Turn(Course):
    """Stand, rise straight to a forward speed [m/s], then turn at a yaw rate [rad/s] for a duration [s]."""

    def __init__(self, forward: float, yaw_rate: float, duration: float) -> None:
        self.forward, self.yaw_rate = forward, yaw_rate
        self._begin, self._turning = _STAND + abs(forward) / _ACCELERATION, False
        self.longest = self._begin + duration

    def speed(self, time: float, base: BaseState) -> float | None:
        """The rising speed [m/s]."""
        if time >= self.longest - 1e-9:
            return None
        self._turning = time >= self._begin - 1e-9
        risen = _ACCELERATION * max(0.0, time - _STAND)
        return math.copysign(min(risen, abs(self.forward)), self.forward)

    def steer(self, base: BaseState, speed: float) -> float:
        """The yaw rate of the turn [rad/s], zero before it."""
        return self.yaw_rate if self._turning else 0.0


@dataclass(frozen=True, kw_only=True)
class TurningPoint:
    """One turn: what was asked for, and how it ended."""

    turn: Turn
    run: Run

    @property
    def gain(self) -> float:
        """Achieved over commanded yaw rate; ``nan`` after a fall."""
        rate = self.run.yaw_rate_rad_s
        return math.nan if rate is None else rate / self.turn.yaw_rate


@dataclass(frozen=True, kw_only=True)
class TurningMap:
    """All turns of one policy."""

    settings: TurningSettings
    points: tuple[TurningPoint, ...]

    @property
    def falls(self) -> int:
        """Turns that ended in a fall."""
        return sum(not point.run.upright for point in self.points)

    @property
    def least_gain(self) -> float:
        """Worst gain of the turns with ``|v w|`` at most half of ``mu g``; ``nan`` where one fell."""
        bound = 0.5 * self.settings.trial.friction * GRAVITY + 1e-9
        gains = [p.gain for p in self.points if abs(p.turn.forward * p.turn.yaw_rate) <= bound]
        return math.nan if any(map(math.isnan, gains)) else min(gains, default=math.nan)

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready numbers; what is not defined becomes null."""
        rows = [
            {
                "command_speed_m_s": point.turn.forward,
                "command_yaw_rate_rad_s": point.turn.yaw_rate,
                "speed_m_s": point.run.held_speed_m_s if point.run.upright else None,
                "yaw_rate_rad_s": point.run.yaw_rate_rad_s,
                "gain": point.gain,
                "fall_reason": point.run.fall_reason,
            }
            for point in self.points
        ]
        return json_ready(
            {
                "friction": self.settings.trial.friction,
                "falls": self.falls,
                "least_gain_up_to_half_of_friction": self.least_gain,
                "turns": rows,
            }
        )


def turning_map(
    pool: TrialPool, settings: TurningSettings, progress: Progress = lambda *_: None
) -> TurningMap:
    """Run every turn; errors as in ``run_cases``."""
    turns = settings.turns()
    runs = run_cases(pool, [settings.case(turn) for turn in turns], progress)
    points = [TurningPoint(turn=turn, run=run) for turn, run in zip(turns, runs, strict=True)]
    return TurningMap(settings=settings, points=tuple(points))


def turning_rows(found: TurningMap) -> list[tuple[str, ...]]:
    """One row per speed: the gain of every fraction as text, ``fell`` where the robot fell."""
    width, rows = len(found.settings.fractions), []
    for index, speed in enumerate(found.settings.speeds):
        points = found.points[index * width : (index + 1) * width]
        cells = (f"{100 * point.gain:.0f} %" if point.run.upright else "fell" for point in points)
        rows.append((f"{speed:g}", f"{found.settings.largest_yaw_rate(speed):.2f}", *cells))
    return rows
