"""How well a policy turns: achieved over commanded yaw rate, over speeds and yaw rates."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sprintlab.commands.state import GRAVITY
from sprintlab.control import Policy
from sprintlab.core.checks import check_positive, check_range
from sprintlab.core.errors import InvalidValueError
from sprintlab.core.json_values import json_ready
from sprintlab.evaluation.pool import TrialPool
from sprintlab.evaluation.results import Trajectory
from sprintlab.evaluation.trial import TrialRequest, run_course
from sprintlab.plant import NOMINAL_TRIAL, BaseState, PlantOptions, TrialSettings
from sprintlab.robots import RobotDescription

LARGEST_YAW_RATE = 1.0
"""Yaw rates are commanded up to this magnitude [rad/s], in training and here (the paper's range)."""

_STAND, _ACCELERATION, _MEASURED = 1.0, 4.0, 2.0  # [s], [m/s^2], [s]


@dataclass(frozen=True, kw_only=True)
class TurningSettings:
    """What is asked for.

    Raises:
        InvalidValueError: a speed, fraction or duration is out of range.
    """

    speeds: tuple[float, ...] = (0.0, 2.0, 4.0, 6.0, 8.0, 10.0, 12.0)
    """Commanded forward speeds [m/s]."""
    fractions: tuple[float, ...] = (-1.0, -0.5, -0.25, 0.25, 0.5, 1.0)
    """Yaw rates as fractions of the largest that friction allows, ``mu g / |v|``, at most 1 rad/s."""
    turn: float = 4.0
    """Duration of each turn [s]; the last 2 s of it are measured."""
    plant: PlantOptions = field(default_factory=PlantOptions)
    """How the robot is simulated."""
    trial: TrialSettings = NOMINAL_TRIAL
    """Friction, payload, initial joint noise."""

    def __post_init__(self) -> None:
        if not self.speeds or not self.fractions:
            raise InvalidValueError("turning.speeds and turning.fractions", (), "at least one of each")
        for speed in self.speeds:
            check_range("turning.speeds", speed, -5.0, 30.0, "m/s")
        for fraction in self.fractions:
            check_range("turning.fractions", fraction, -1.0, 1.0)
            check_positive("turning.fractions (magnitude)", abs(fraction))
        check_range("turning.turn", self.turn, _MEASURED, 60.0, "s")

    @property
    def cells(self) -> tuple[TurningCommand, ...]:
        """Every combination, by speed, then by yaw rate."""
        return tuple(
            TurningCommand(speed=speed, yaw_rate=fraction * self.largest_yaw_rate(speed))
            for speed in self.speeds
            for fraction in self.fractions
        )

    def largest_yaw_rate(self, speed: float) -> float:
        """What friction allows at a speed [rad/s]: ``|v w| <= mu g``, and at most 1 rad/s."""
        return min(LARGEST_YAW_RATE, self.trial.friction * GRAVITY / max(abs(speed), 1e-6))


@dataclass(frozen=True, kw_only=True)
class TurningCommand:
    """A forward speed [m/s] and a yaw rate [rad/s]."""

    speed: float
    yaw_rate: float


@dataclass(frozen=True, kw_only=True)
class TurningPoint:
    """One turn.

    Attributes:
        command: what was asked for.
        yaw_rate: achieved, mean over the last 2 s [rad/s]; ``nan`` after a fall.
        speed: achieved forward speed, same time [m/s]; ``nan`` after a fall.
        fall_reason: ``""`` where the robot did not fall.
    """

    command: TurningCommand
    yaw_rate: float
    speed: float
    fall_reason: str

    @property
    def gain(self) -> float:
        """Achieved over commanded yaw rate."""
        return self.yaw_rate / self.command.yaw_rate


@dataclass(frozen=True, kw_only=True)
class TurningMap:
    """All turns of one policy."""

    settings: TurningSettings
    points: tuple[TurningPoint, ...]

    @property
    def falls(self) -> int:
        """Turns that ended in a fall."""
        return sum(bool(point.fall_reason) for point in self.points)

    @property
    def moderate(self) -> tuple[TurningPoint, ...]:
        """The turns with ``|v w|`` at most half of ``mu g``."""
        bound = 0.5 * self.settings.trial.friction * GRAVITY + 1e-9
        return tuple(p for p in self.points if abs(p.command.speed * p.command.yaw_rate) <= bound)

    @property
    def least_gain(self) -> float:
        """Worst achieved over commanded yaw rate of the moderate turns; ``nan`` where one fell."""
        gains = [point.gain for point in self.moderate]
        return float(np.min(gains)) if gains else math.nan

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready numbers; what is not defined becomes null."""
        rows = [
            {
                "command_speed_m_s": point.command.speed,
                "command_yaw_rate_rad_s": point.command.yaw_rate,
                "speed_m_s": point.speed,
                "yaw_rate_rad_s": point.yaw_rate,
                "gain": point.gain,
                "fall_reason": point.fall_reason,
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


class _Turn:
    """Stand, rise straight to the speed, then turn; course and steering of one trial."""

    def __init__(self, command: TurningCommand, duration: float) -> None:
        self._command = command
        self._begin = _STAND + abs(command.speed) / _ACCELERATION
        self.longest = self._begin + duration
        self._turning = False

    def speed(self, time: float, base: BaseState) -> float | None:
        if time >= self.longest - 1e-9:
            return None
        self._turning = time >= self._begin - 1e-9
        risen = _ACCELERATION * max(0.0, time - _STAND)
        return math.copysign(min(risen, abs(self._command.speed)), self._command.speed)

    def steer(self, base: BaseState, speed: float) -> float:
        return self._command.yaw_rate if self._turning else 0.0


def turning_map(
    pool: TrialPool,
    settings: TurningSettings,
    progress: Callable[[TurningPoint, float], None] = lambda *_: None,
) -> TurningMap:
    """Run every turn.

    Args:
        pool: policy, robot and processes.
        settings: what is asked for.
        progress: called with every turn and the share done.

    Raises:
        SimulationError: as ``run_trial``.
    """
    errands = [(settings, command) for command in settings.cells]
    points: list[TurningPoint] = []
    for point in pool.map(turn_once, errands):
        points.append(point)
        progress(point, len(points) / len(errands))
    return TurningMap(settings=settings, points=tuple(points))


def turn_once(
    policy: Policy, robot: RobotDescription, errand: tuple[TurningSettings, TurningCommand]
) -> TurningPoint:
    """One turn; errors as in ``run_trial``."""
    settings, command = errand
    turn = _Turn(command, settings.turn)
    request = TrialRequest(
        top_speed=max(abs(command.speed), 0.1),
        settings=settings.trial,
        plant=settings.plant,
        keep_trajectory=True,
    )
    trial = run_course(policy, robot, request, turn, turn.steer)
    assert trial.trajectory is not None
    fell = bool(trial.fall_reason)
    yaw_rate, speed = (math.nan, math.nan) if fell else _achieved(trial.trajectory)
    return TurningPoint(command=command, yaw_rate=yaw_rate, speed=speed, fall_reason=trial.fall_reason)


def _achieved(trajectory: Trajectory) -> tuple[float, float]:
    """Mean yaw rate [rad/s] and forward speed [m/s] over the last 2 s."""
    last = trajectory.time >= trajectory.time[-1] - _MEASURED
    time, heading = trajectory.time[last], trajectory.heading[last]
    rate = (heading[-1] - heading[0]) / (time[-1] - time[0])
    return float(rate), float(trajectory.velocity[last, 0].mean())


def turning_rows(found: TurningMap) -> Sequence[tuple[str, ...]]:
    """One row per speed: the gain of every fraction as text, ``fell`` where the robot fell."""
    width = len(found.settings.fractions)
    rows: list[tuple[str, ...]] = []
    for index, speed in enumerate(found.settings.speeds):
        points = found.points[index * width : (index + 1) * width]
        cells = ("fell" if point.fall_reason else f"{100 * point.gain:.0f} %" for point in points)
        rows.append((f"{speed:g}", f"{found.settings.largest_yaw_rate(speed):.2f}", *cells))
    return rows
