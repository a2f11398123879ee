"""Where a run goes: the line along which it began, and the position fixes that tell how far the robot is."""

from __future__ import annotations

import math

import numpy as np

from sprintlab.commands import heading_angle, wrap_angle
from sprintlab.deployment.messages import FloatArray, PositionFix, RobotState
from sprintlab.deployment.operators.base import TrackPoint

_FARTHEST = 1e8  # m: beyond the coordinates of every map
_FASTEST = 100.0  # m/s
_TIMEOUT = 0.5  # s after which a position fix is no longer used


class Course:
    """The line along which a run began, and the last sound position fix."""

    def __init__(self) -> None:
        self._heading = 0.0
        self._origin: FloatArray | None = None
        self._fix: PositionFix | None = None
        self._taken_at = 0.0

    def start(self, state: RobotState) -> None:
        """Begin a run along the robot's present heading."""
        self._heading, self._origin = float(heading_angle(state.quaternion)), None

    def take(self, fix: PositionFix, time: float) -> bool:
        """Keep a fix that arrived at ``time`` [s]; False if it is absurd or not newer than the last."""
        near = (np.abs(fix.position) <= _FARTHEST).all() and (np.abs(fix.velocity) <= _FASTEST).all()
        if not near or (self._fix is not None and fix.sequence <= self._fix.sequence):
            return False
        self._fix, self._taken_at = fix, time
        return True

    def forget_fix(self) -> None:
        """Take any number of the next fix: the robot may have been restarted."""
        self._fix = None

    def heading(self, state: RobotState) -> float:
        """Yaw away from the course [rad]."""
        return float(wrap_angle(np.asarray(float(heading_angle(state.quaternion)) - self._heading)))

    def point(self, time: float) -> TrackPoint | None:
        """Where the robot is at ``time`` [s]; None without a fix of the last half second."""
        age = time - self._taken_at
        if self._fix is None or age > _TIMEOUT:
            return None
        if self._origin is None:
            self._origin = self._fix.position
        c, s = math.cos(self._heading), math.sin(self._heading)
        east, north = (self._fix.position - self._origin)[:2].tolist()
        vx, vy = self._fix.velocity[:2].tolist()
        speed = c * vx + s * vy
        return TrackPoint(c * east + s * north + speed * age, c * north - s * east, speed)
