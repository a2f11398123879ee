"""Motions that need no policy: rising, standing, gathering the feet, sinking."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from sprintlab.deployment.controller.legs import GRAVITY, Legs, folded_pose, tucked_pose
from sprintlab.deployment.messages import FloatArray, RobotState
from sprintlab.robots import RobotDescription

TUCK_TIME, RISE_TIME, SINK_TIME, SETTLE_TIME = 1.0, 1.5, 1.5, 0.4
"""Durations of folding the legs beside the belly, rising, sinking over the feet, taking a pose over [s]."""
# Shares of sqrt(height / g), the time in which a robot tips over its feet: two feet carry for less.
_SHIFT = 0.17  # until a pair of legs carries all
_SWING = 0.43  # while the other pair is in the air
_LAND = 0.21  # until all legs carry again
_REST = 2.0  # on all feet after two steps, until the trunk no longer drifts
_LIFT = 0.1  # share of the standing height
_LONGEST = 0.985  # share of a stretched leg: beyond, a knee turns without end where its foot moves up
_STEP = 1e-3  # s over which speeds are taken
_DIAGONALS = ((0, 3), (1, 2))
_EVERYONE = (0, 1, 2, 3)


class FootKey(NamedTuple):
    """Where the feet are at the end of a phase, and what they carry."""

    feet: FloatArray  # from the trunk's middle [m] ``(4, 3)``
    loads: FloatArray  # vertical forces [N] ``(4,)``
    duration: float = 0.0  # time of the phase that ends here [s]; of the first key it counts for nothing
    airborne: tuple[int, ...] = ()  # legs that are lifted meanwhile


class Motion:
    """Feet that move from key to key while they carry the robot; ``end_time`` [s] is when they rest.

    The targets ask for the torques that carry the robot on the feet that stand, and for those that overcome
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
                share = max((time - begin) / key.duration, 0.0)
                part = _smooth(share)
                feet = before.feet + (key.feet - before.feet) * part
                lift = _LIFT * self._robot.standing_height * (4.0 * share * (1.0 - share)) ** 3
                feet[list(key.airborne), 2] += lift
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
        FootKey(tucked.feet, legs.loads(tucked.feet, _EVERYONE), TUCK_TIME),
        FootKey(folded, legs.loads(folded, _EVERYONE), 0.5 * RISE_TIME),
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
    loads, low = legs.loads(feet, _EVERYONE), feet.copy()
    low[:, 2] = np.maximum(feet[:, 2], -legs.shortest)
    keys = (
        FootKey(feet, loads),
        FootKey(low, loads, SINK_TIME),
        _tucked(robot)._replace(duration=TUCK_TIME),
    )
    return Motion(robot, keys, start, start_time)


def gather_motion(robot: RobotDescription, state: RobotState, start: FloatArray, start_time: float) -> Motion:
    """Two steps that bring the feet to where they stand below a robot in its default pose.

    First one diagonal pair of feet is lifted and put down, then the other, at the height that the trunk has:
    no foot is dragged while it carries. The pair that carries better, whose line passes nearer below the
    trunk's middle, goes second. A rest on all feet ends the motion: the trunk may still drift a little.
    """
    legs = Legs(robot)
    natural = math.sqrt(robot.standing_height / GRAVITY)
    goal = legs.feet(robot.default_pose)
    feet = legs.level_feet(state)
    feet[:, 2] = feet[:, 2].min()  # a foot in the air is put down
    feet = legs.within_reach(feet, _LONGEST)
    keys = [FootKey(feet, legs.loads(feet, _EVERYONE))]
    second, first = sorted(_DIAGONALS, key=lambda pair: _distance_from_middle(feet, pair))
    for swinging, carrying in ((first, second), (second, first)):
        moved = feet.copy()
        moved[list(swinging), :2] = goal[list(swinging), :2]
        alone = legs.loads(feet, carrying)
        keys.append(FootKey(feet, alone, _SHIFT * natural))
        keys.append(FootKey(moved, alone, _SWING * natural, swinging))
        keys.append(FootKey(moved, legs.loads(moved, _EVERYONE), _LAND * natural))
        feet = moved
    keys.append(FootKey(feet, legs.loads(feet, _EVERYONE), _REST * natural))
    return Motion(robot, keys, start, start_time)


def feet_apart(robot: RobotDescription, state: RobotState) -> float:
    """Greatest horizontal distance of a foot from its place in the default pose [m]."""
    legs = Legs(robot)
    away = (legs.level_feet(state) - legs.feet(robot.default_pose))[:, :2]
    return float(np.hypot(away[:, 0], away[:, 1]).max())


def _standing(robot: RobotDescription) -> FootKey:
    legs = Legs(robot)
    feet = legs.feet(robot.default_pose)
    return FootKey(feet, legs.loads(feet, _EVERYONE))


def _tucked(robot: RobotDescription) -> FootKey:
    feet = Legs(robot).feet(tucked_pose(robot))
    return FootKey(feet, np.zeros(len(feet)))


def _distance_from_middle(feet: FloatArray, pair: tuple[int, int]) -> float:
    """How far the line through two feet passes from below the trunk's middle [m]."""
    (ax, ay), (bx, by) = feet[pair[0], :2].tolist(), feet[pair[1], :2].tolist()
    return abs(ax * by - ay * bx) / max(math.hypot(bx - ax, by - ay), 1e-9)


def _smooth(share: float) -> float:
    """From 0 to 1 with rest at both ends."""
    share = min(max(share, 0.0), 1.0)
    return share * share * (3.0 - 2.0 * share)
