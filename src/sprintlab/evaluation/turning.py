"""How well a policy turns: achieved over commanded yaw rate, over speeds and yaw rates."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

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
    fractions: tuple[float, ...] = (-1.0, -0.5, -0.25, 0.25, 0.5, 1.0)  # shares of the largest yaw rate
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


def turning_map(
    pool: TrialPool, settings: TurningSettings, progress: Progress = lambda *_: None
) -> dict[str, Any]:
    """Run every turn, and give ``turning_numbers``; errors as in ``run_cases``."""
    cases = [settings.case(turn) for turn in settings.turns()]
    return turning_numbers(settings, run_cases(pool, cases, progress))


def turning_numbers(settings: TurningSettings, runs: Sequence[Run]) -> dict[str, Any]:
    """JSON-ready numbers of each turn; a gain is the achieved over the commanded yaw rate.

    The least gain is that of the turns with ``|v w|`` at most half of ``mu g``. What a fall leaves undefined
    is null.
    """
    bound, gains, rows = 0.5 * settings.trial.friction * GRAVITY + 1e-9, list[float](), list[dict[str, Any]]()
    for turn, run in zip(settings.turns(), runs, strict=True):
        rate = run.yaw_rate_rad_s
        gain = math.nan if rate is None else rate / turn.yaw_rate
        gains += [gain] if abs(turn.forward * turn.yaw_rate) <= bound else []
        rows.append(
            {
                "command_speed_m_s": turn.forward,
                "command_yaw_rate_rad_s": turn.yaw_rate,
                "speed_m_s": run.held_speed_m_s if run.upright else None,
                "yaw_rate_rad_s": rate,
                "gain": gain,
                "fall_reason": run.fall_reason,
            }
        )
    return json_ready(
        {
            "friction": settings.trial.friction,
            "falls": sum(not run.upright for run in runs),
            "least_gain_up_to_half_of_friction": math.nan
            if np.isnan(gains).any()
            else min(gains, default=math.nan),
            "turns": rows,
        }
    )


def turning_rows(settings: TurningSettings, numbers: dict[str, Any]) -> list[tuple[str, ...]]:
    """One row per speed: the gain of every fraction as text, ``fell`` where the robot fell."""
    cells = ["fell" if turn["fall_reason"] else f"{100 * turn['gain']:.0f} %" for turn in numbers["turns"]]
    width = len(settings.fractions)
    return [
        (f"{speed:g}", f"{settings.largest_yaw_rate(speed):.2f}", *cells[index * width : (index + 1) * width])
        for index, speed in enumerate(settings.speeds)
    ]
