"""Joint motions that need no policy: folding, rising, sinking."""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

import numpy as np

from sprintlab.deployment.interface import FloatArray
from sprintlab.robots import RobotDescription

_KNEE_RESERVE = 0.1  # rad kept between the folded knee and its end stop


class Waypoint(NamedTuple):
    """A pose [rad] ``(12,)`` and the time to get there from the one before [s]."""

    pose: FloatArray
    duration: float


class Motion(Protocol):
    """Joint targets over time, with an end."""

    @property
    def end_time(self) -> float:
        """From when on the targets rest [s]."""
        ...

    def target(self, time: float) -> FloatArray:
        """Joint targets [rad] ``(12,)`` at ``time`` [s]."""
        ...


class JointMotion:
    """Smooth joint targets through waypoints, at rest at each of them.

    Args:
        start: pose at ``start_time`` [rad] ``(12,)``.
        start_time: [s].
        waypoints: where to go.
    """

    def __init__(self, start: FloatArray, start_time: float, *waypoints: Waypoint) -> None:
        self._start, self._start_time, self._waypoints = start, start_time, waypoints

    @property
    def end_time(self) -> float:
        """When the last waypoint is reached [s]."""
        return self._start_time + sum(waypoint.duration for waypoint in self._waypoints)

    def target(self, time: float) -> FloatArray:
        """Joint targets at ``time`` [s]; the last waypoint from the end on."""
        begin, pose = self._start_time, self._start
        for waypoint in self._waypoints:
            if time < begin + waypoint.duration:
                return pose + (waypoint.pose - pose) * _smooth((time - begin) / waypoint.duration)
            begin, pose = begin + waypoint.duration, waypoint.pose
        return pose


class SinkMotion:
    """Straight down over the feet, wherever they stand: no leg is braced against another.

    In the plane of a leg with thigh ``a``, shank ``b``, hip angle ``h`` and knee angle ``k`` the foot is at
    ``x = -(a sin h + b sin(h + k))``, ``z = -(a cos h + b cos(h + k))`` from the hip. ``x`` is kept, ``z``
    rises to that of the folded pose, or as far as the knee bends.

    Args:
        robot: link lengths and limits.
        start: pose at ``start_time`` [rad] ``(12,)``.
        start_time: [s].
        duration: [s].
    """

    def __init__(
        self, robot: RobotDescription, start: FloatArray, start_time: float, duration: float
    ) -> None:
        self._a, self._b = robot.mechanics.thigh_length, robot.mechanics.shank_length
        self._start_time, self._duration = start_time, duration
        self._abad, hip, knee = start.reshape(-1, 3).T
        self._bend = np.sign(robot.default_pose.reshape(-1, 3)[:, 2])
        self._x = -(self._a * np.sin(hip) + self._b * np.sin(hip + knee))
        self._z = -(self._a * np.cos(hip) + self._b * np.cos(hip + knee))
        folded = folded_pose(robot).reshape(-1, 3)[:, 2]
        self._shortest = np.sqrt(self._a**2 + self._b**2 + 2.0 * self._a * self._b * np.cos(folded))

    @property
    def end_time(self) -> float:
        """When the robot lies [s]."""
        return self._start_time + self._duration

    def target(self, time: float) -> FloatArray:
        """Joint targets [rad] ``(12,)`` at ``time`` [s]."""
        share = _smooth((time - self._start_time) / self._duration)
        z = self._z + (-self._shortest - self._z) * share
        reach = np.clip(np.hypot(self._x, z), self._shortest, self._a + self._b)
        cosine = (reach**2 - self._a**2 - self._b**2) / (2.0 * self._a * self._b)
        knee = self._bend * np.arccos(np.clip(cosine, -1.0, 1.0))
        inner = np.arctan2(self._b * np.sin(knee), self._a + self._b * np.cos(knee))
        hip = np.arctan2(-self._x, -z) - inner
        return np.stack((self._abad, hip, knee), axis=1).reshape(-1)


def _smooth(share: float) -> float:
    """From 0 to 1 with rest at both ends."""
    share = min(max(share, 0.0), 1.0)
    return share * share * (3.0 - 2.0 * share)


def folded_pose(robot: RobotDescription) -> FloatArray:
    """Pose of a lying robot [rad] ``(12,)``: knees folded as far as is free, feet below the hips.

    With thigh ``a``, shank ``b`` and knee angle ``k`` the foot is below the hip for a hip angle
    ``atan2(-b sin k, a + b cos k)``.
    """
    a, b = robot.mechanics.thigh_length, robot.mechanics.shank_length
    reserve = robot.soft_stop.zone + _KNEE_RESERVE
    poses = []
    for leg in range(len(robot.leg_names)):
        lower, upper = robot.position_limits[3 * leg + 2]
        bends_back = robot.default_pose[3 * leg + 2] < 0.0
        knee = float(lower) + reserve if bends_back else float(upper) - reserve
        hip = math.atan2(-b * math.sin(knee), a + b * math.cos(knee))
        poses.append((0.0, hip, knee))
    return np.asarray(poses, dtype=np.float64).reshape(-1)
