"""A running track as a path, and the yaw rate that keeps a robot on it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sprintlab.commands.heading import heading_command, wrap_angle
from sprintlab.commands.state import limit_yaw_rate
from sprintlab.core.array_types import FloatArray

KERB_DISTANCE = 0.30
"""The measured line of lane 1 lies this far outside its kerb [m] (World Athletics, Technical Rule 14.2)."""

LANE_WIDTH = 1.22
"""Width of a lane [m] (World Athletics, Technical Rule 14.4)."""


class PathPoint(NamedTuple):
    """Where a robot is, as seen from the path."""

    progress: float  # arc length of the nearest point of the path [m], from 0 to the path's length
    offset: float  # distance from the path [m], positive to the left (the inside of a track)
    direction: float  # direction of the path there [rad], 0 along x at the start
    curvature: float  # curvature of the path there [1/m], positive to the left


@dataclass(frozen=True, kw_only=True)
class Track:
    """Two straights and two half circles, run anticlockwise from the beginning of a bend.

    The defaults are lane 1 of a standard track: bends of 36.50 m at the kerb, measured 0.30 m outside it,
    straights of 84.39 m, 400.00 m in all (World Athletics, Track and Field Facilities Manual).
    """

    radius: float = 36.50 + KERB_DISTANCE  # radius of the bends, on the line that is run [m]
    straight: float = 84.39  # length of each straight [m]

    @property
    def length(self) -> float:
        """One lap [m]."""
        return 2.0 * (math.pi * self.radius + self.straight)

    def locate(self, x: float, y: float) -> PathPoint:
        """The nearest point of the path, for a place in the frame of the start (x ahead, y to the left) [m].

        The first bend turns about (0, radius) from (0, 0) to (0, 2 radius); the straight back lies at
        ``y = 2 radius`` and runs along -x, the second bend turns about (-straight, radius).
        """
        radius, straight = self.radius, self.straight
        bend = math.pi * radius
        if x >= 0.0:
            return self._in_bend(x, y - radius, 0.0, 0.0)
        if x <= -straight:
            return self._in_bend(-(x + straight), radius - y, bend + straight, math.pi)
        if y > radius:
            return PathPoint(bend - x, 2.0 * radius - y, math.pi, 0.0)
        return PathPoint(2.0 * bend + 2.0 * straight + x, y, 2.0 * math.pi, 0.0)

    def _in_bend(self, ahead: float, left: float, start: float, direction: float) -> PathPoint:
        """In a bend whose centre is the origin and which begins at (0, -radius)."""
        angle = math.atan2(ahead, -left)
        return PathPoint(
            start + self.radius * angle,
            self.radius - math.hypot(ahead, left),
            direction + angle,
            1.0 / self.radius,
        )


def along_track(track: Track, qpos: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Distance run along a track [m] and offset from its line [m] of a recorded base, both ``(T,)``.

    Args:
        track: its start is where and in the direction along x in which the recording begins.
        qpos: ``(T, 2 or more)`` positions of the base first [m]; the distance goes on over the start line.
    """
    points = [track.locate(x, y) for x, y in (qpos[:, :2] - qpos[0, :2]).tolist()]
    progress = np.unwrap([point.progress for point in points], period=track.length)
    return progress, np.array([point.offset for point in points])


def path_yaw_rate(point: PathPoint, heading: float, speed: float, *, friction: float = 0.7) -> float:
    """Yaw-rate command [rad/s] that follows a path: its curvature times the speed, and the heading loop.

    Args:
        point: where the robot is.
        heading: heading of the robot [rad], in the frame of the path's directions.
        speed: commanded forward speed [m/s].
        friction: coefficient for ``|v w| <= mu g``; the default is the lowest of the evaluation.
    """
    error = float(wrap_angle(heading - point.direction))
    feedback = float(heading_command(error, point.offset, speed, friction=friction))
    return float(limit_yaw_rate(feedback + speed * point.curvature, speed, friction))
