"""Where a run goes: the line along which it began, and the position fixes that tell how far it is off."""

from __future__ import annotations

import math

import numpy as np

from sprintlab.commands import heading_angle, wrap_angle
from sprintlab.deployment.interface import FloatArray, PositionFix, RobotState

_FARTHEST = 1e8  # m: beyond the coordinates of every map
_FASTEST = 100.0  # m/s


class Course:
    """The line along which a run began: what heading, offset and speed are relative to."""

    def __init__(self, heading: float) -> None:
        self.heading = heading
        self.origin: FloatArray | None = None

    def relative_heading(self, state: RobotState) -> float:
        """Yaw away from the course [rad]."""
        return float(wrap_angle(np.asarray(float(heading_angle(state.quaternion)) - self.heading)))

    def offset_and_speed(self, fix: PositionFix | None) -> tuple[float, float | None]:
        """Offset to the left [m] and speed along the course [m/s]; zero and None without a fix."""
        if fix is None:
            return 0.0, None
        if self.origin is None:
            self.origin = fix.position
        c, s = math.cos(self.heading), math.sin(self.heading)
        east, north = (fix.position - self.origin)[:2].tolist()
        vx, vy = fix.velocity[:2].tolist()
        return c * north - s * east, c * vx + s * vy


class LastFix:
    """The last sound position fix.

    Args:
        timeout: age from which on it is no longer used [s].
    """

    def __init__(self, timeout: float) -> None:
        self._timeout = timeout
        self._fix: PositionFix | None = None
        self._taken_at = 0.0

    def take(self, fix: PositionFix, time: float) -> bool:
        """Keep a fix that arrived at ``time`` [s]; False if it is absurd or not newer than the last."""
        near = (np.abs(fix.position) <= _FARTHEST).all() and (np.abs(fix.velocity) <= _FASTEST).all()
        if not near or (self._fix is not None and fix.sequence <= self._fix.sequence):
            return False
        self._fix, self._taken_at = fix, time
        return True

    def fresh(self, time: float) -> PositionFix | None:
        """The fix, unless it is too old at ``time`` [s]."""
        return self._fix if time - self._taken_at <= self._timeout else None

    def forget(self) -> None:
        """Take any number of the next fix."""
        self._fix = None
