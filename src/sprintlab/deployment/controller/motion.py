"""Joint motions that need no policy: folding, rising, sinking."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from sprintlab.deployment.interface import FloatArray
from sprintlab.robots import RobotDescription

_KNEE_RESERVE = 0.1  # rad kept between the folded knee and its end stop


class Waypoint(NamedTuple):
    """A pose [rad] ``(12,)`` and the time to get there from the one before [s]."""

    pose: FloatArray
    duration: float


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
                share = min(max((time - begin) / waypoint.duration, 0.0), 1.0)
                return pose + (waypoint.pose - pose) * (share * share * (3.0 - 2.0 * share))
            begin, pose = begin + waypoint.duration, waypoint.pose
        return pose


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
