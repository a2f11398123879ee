"""How well a policy turns: achieved over commanded yaw rate, over speeds and yaw rates."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from sprintlab.core.checks import check_range
from sprintlab.core.constants import GRAVITY
from sprintlab.core.json_values import json_ready
from sprintlab.evaluation.pool import TrialPool
from sprintlab.evaluation.sweep import Case, Progress, Run, run_cases
from sprintlab.evaluation.trial import Course, TrialRequest
from sprintlab.plant import NOMINAL_TRIAL, BaseState, PlantOptions

LARGEST_YAW_RATE = 1.0
"""Yaw rates are commanded up to this magnitude [rad/s], in training and here (the paper's range)."""
FRACTIONS = (-1.0, -0.5, -0.25, 0.25, 0.5, 1.0)
"""Shares of the largest yaw rate that are commanded at every speed."""
TURN_TIME = 4.0
"""Duration of each turn [s]; the last 2 s of it are measured."""

_STAND, _ACCELERATION = 1.0, 4.0  # [s], [m/s^2]


def largest_yaw_rate(speed: float) -> float:
    """What friction allows at a speed [rad/s]: ``|v w| <= mu g``, and at most 1 rad/s."""
    return min(LARGEST_YAW_RATE, NOMINAL_TRIAL.friction * GRAVITY / max(abs(speed), 1e-6))


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

    def case(self, plant: PlantOptions | None = None) -> Case:
        """The turn as a run of a sweep."""
        speed = max(abs(self.forward), 0.1)
        request = TrialRequest(top_speed=speed, plant=plant or PlantOptions(), keep_trajectory=True)
        return Case(group=f"{self.forward:g} m/s", request=request, course=self)


def turns(speeds: Sequence[float]) -> list[Turn]:
    """Every fraction of the largest yaw rate at every forward speed [m/s]."""
    return [
        Turn(speed, fraction * largest_yaw_rate(speed), TURN_TIME)
        for speed in speeds
        for fraction in FRACTIONS
    ]


def turning_map(
    pool: TrialPool, speeds: Sequence[float], plant: PlantOptions, progress: Progress = lambda *_: None
) -> dict[str, Any]:
    """Run every turn, and give ``turning_numbers``; errors as in ``run_cases``.

    Raises:
        InvalidValueError: there is no speed, or one outside -5 to 30 m/s.
    """
    check_range("number of speeds", len(speeds), 1, 1000)
    for speed in speeds:
        check_range("speeds", speed, -5.0, 30.0, "m/s")
    asked = turns(speeds)
    return turning_numbers(asked, run_cases(pool, [turn.case(plant) for turn in asked], progress))


def turning_numbers(asked: Sequence[Turn], runs: Sequence[Run]) -> dict[str, Any]:
    """JSON-ready numbers of each turn; a gain is the achieved over the commanded yaw rate.

    The least gain is that of the turns with ``|v w|`` at most half of ``mu g``. What a fall leaves undefined
    is null.
    """
    bound, gains, rows = 0.5 * NOMINAL_TRIAL.friction * GRAVITY + 1e-9, list[float](), list[dict[str, Any]]()
    for turn, run in zip(asked, runs, strict=True):
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
    least = math.nan if np.isnan(gains).any() else min(gains, default=math.nan)
    return json_ready(
        {
            "friction": NOMINAL_TRIAL.friction,
            "falls": sum(not run.upright for run in runs),
            "least_gain_up_to_half_of_friction": least,
            "turns": rows,
        }
    )


def turning_rows(numbers: dict[str, Any]) -> list[tuple[str, ...]]:
    """One row per speed: the gain of every fraction as text, ``fell`` where the robot fell."""
    rows: dict[float, list[str]] = {}
    for turn in numbers["turns"]:
        cells = rows.setdefault(turn["command_speed_m_s"], [])
        cells.append("fell" if turn["fall_reason"] else f"{100 * turn['gain']:.0f} %")
    return [(f"{speed:g}", f"{largest_yaw_rate(speed):.2f}", *cells) for speed, cells in rows.items()]
