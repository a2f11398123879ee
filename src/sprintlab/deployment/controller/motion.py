"""Motions that need no policy: rising, standing, sinking."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from sprintlab.deployment.controller.legs import Legs, folded_pose, tucked_pose
from sprintlab.deployment.messages import FloatArray
from sprintlab.robots import RobotDescription

TUCK_TIME, RISE_TIME, SINK_TIME, SETTLE_TIME = 1.0, 1.5, 1.5, 0.4
"""Durations of folding the legs beside the belly, rising, sinking over the feet, taking a pose over [s]."""
_STEP = 1e-3  # s over which speeds are taken


class FootKey(NamedTuple):
    """Where the feet are at the end of a phase, and what they carry."""

    feet: FloatArray  # from the trunk's middle [m] ``(4, 3)``
    loads: FloatArray  # vertical forces [N] ``(4,)``
    duration: float = 0.0  # time of the phase that ends here [s]; of the first key it counts for nothing


class Motion:
    """Feet that move from key to key while they carry the robot; ``end_time`` [s] is when they rest.

    The targets ask for the torques that carry the robot on its feet, and for those that overcome
    the drives' damping: ``q + (tau + D dq/dt) / K``. They begin at ``start`` [rad] ``(joints,)`` at
    ``start_time`` [s]; the first phase fades out what that differs from the first key.
    """

    def __init__(
        self, robot: RobotDescription, keys: Sequence[FootKey], start: FloatArray, start_time: float
    ) -> None:
        self._robot, self._legs = robot, Legs(robot)
        self._start_time, self._keys = start_time, keys
        self.end_time = start_time + sum(key.duration for key in keys[1:])
        self._jump = start - self._plan(start_time)
        self._end = self._plan(self.end_time)

    def target(self, time: float) -> FloatArray:
        """Joint targets [rad] ``(joints,)`` at ``time`` [s]."""
        if time >= self.end_time:
            return self._end
        fading = 1.0 - _smooth((time - self._start_time) / self._keys[1].duration)
        return self._plan(time) + self._jump * fading

    def _plan(self, time: float) -> FloatArray:
        pose, loads = self._pose(time)
        velocity = (self._pose(time + _STEP)[0] - pose) / _STEP
        torque = self._legs.carrying_torque(pose, loads) + self._robot.damping * velocity
        return pose + torque / self._robot.stiffness

    def _pose(self, time: float) -> tuple[FloatArray, FloatArray]:
        """Joint positions [rad] ``(joints,)`` and loads [N] ``(4,)`` wanted at ``time`` [s]."""
        begin = self._start_time
        for before, key in pairwise(self._keys):
            if time < begin + key.duration:
                part = _smooth((time - begin) / key.duration)
                feet = before.feet + (key.feet - before.feet) * part
                return self._legs.pose(feet), before.loads + (key.loads - before.loads) * part
            begin += key.duration
        return self._legs.pose(self._keys[-1].feet), self._keys[-1].loads


def rise_motion(robot: RobotDescription, start: FloatArray, start_time: float) -> Motion:
    """From wherever the legs of a lying robot are to the default pose.

    The legs are tucked beside the belly; then all of them turn under the hips and stretch, alike, so that the
    feet stay where they stand.
    """
    legs, tucked = Legs(robot), _tucked(robot)
    folded = legs.feet(folded_pose(robot))
    keys = (
        tucked,
        FootKey(tucked.feet, legs.loads(tucked.feet), TUCK_TIME),
        FootKey(folded, legs.loads(folded), 0.5 * RISE_TIME),
        _standing(robot)._replace(duration=0.5 * RISE_TIME),
    )
    return Motion(robot, keys, start, start_time)


def settle_motion(robot: RobotDescription, start: FloatArray, start_time: float) -> Motion:
    """To the default pose, at rest at both ends."""
    standing = _standing(robot)
    return Motion(robot, (standing, standing._replace(duration=SETTLE_TIME)), start, start_time)


def sink_motion(robot: RobotDescription, start: FloatArray, start_time: float) -> Motion:
    """Straight down over the feet, wherever they stand, then on the belly with the legs tucked beside it."""
    legs = Legs(robot)
    feet = legs.feet(start)
    loads, low = legs.loads(feet), feet.copy()
    low[:, 2] = np.maximum(feet[:, 2], -legs.shortest)
    keys = (
        FootKey(feet, loads),
        FootKey(low, loads, SINK_TIME),
        _tucked(robot)._replace(duration=TUCK_TIME),
    )
    return Motion(robot, keys, start, start_time)


def _standing(robot: RobotDescription) -> FootKey:
    legs = Legs(robot)
    feet = legs.feet(robot.default_pose)
    return FootKey(feet, legs.loads(feet))


def _tucked(robot: RobotDescription) -> FootKey:
    feet = Legs(robot).feet(tucked_pose(robot))
    return FootKey(feet, np.zeros(len(feet)))


def _smooth(share: float) -> float:
    """From 0 to 1 with rest at both ends."""
    share = min(max(share, 0.0), 1.0)
    return share * share * (3.0 - 2.0 * share)
