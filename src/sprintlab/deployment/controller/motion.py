"""Joint motions that need no policy: folding, rising, gathering, sinking."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from sprintlab.deployment.controller.legs import (
    GRAVITY,
    Legs,
    folded_pose,
    level_feet,
    tucked_pose,
)
from sprintlab.deployment.interface import FloatArray, RobotState
from sprintlab.robots import RobotDescription

# Of sqrt(height / g), the time in which a robot tips over its feet: what two feet carry must be shorter.
_SHIFT = 0.17  # until a pair of legs carries all
_SWING = 0.43  # of the other pair through the air
_LAND = 0.21  # until all legs carry again
_REST = 2.0  # on all feet after two steps, until the trunk no longer drifts
_LIFT = 0.1  # of the standing height
_LONGEST = 0.985  # of a stretched leg: beyond, a knee turns without end where its foot moves up
_STEP = 1e-3  # s over which speeds are taken
_DIAGONALS = ((0, 3), (1, 2))
_EVERYONE = (0, 1, 2, 3)


class Motion:
    """Joint targets over time: phases, one after the other.

    Args:
        start_time: [s].
        phases: duration [s], and targets [rad] ``(joints,)`` by the share of the phase that has passed.

    Attributes:
        end_time: from when on the targets rest [s].
    """

    def __init__(self, start_time: float, *phases: tuple[float, Callable[[float], FloatArray]]) -> None:
        self._start_time, self._phases = start_time, phases
        self.end_time = start_time + sum(duration for duration, _ in phases)

    def target(self, time: float) -> FloatArray:
        """Joint targets [rad] ``(joints,)`` at ``time`` [s]."""
        begin = self._start_time
        for duration, path in self._phases:
            if time < begin + duration:
                return path((time - begin) / duration)
            begin += duration
        return self._phases[-1][1](1.0)


def settle_motion(start: FloatArray, pose: FloatArray, start_time: float, duration: float) -> Motion:
    """From one pose to another [rad] ``(joints,)`` in ``duration`` [s], at rest at both ends."""
    return Motion(start_time, (duration, lambda share: start + (pose - start) * _smooth(share)))


def sink_motion(
    robot: RobotDescription, start: FloatArray, start_time: float, duration: float, tuck_time: float
) -> Motion:
    """Straight down over the feet, wherever they stand, then down on the belly: no leg works against another.

    In the plane of each leg the foot keeps its place along the trunk, and rises to the height of the folded
    pose, or as far as the knee bends. Then all legs turn back to ``tucked_pose``.

    Args:
        robot: link lengths and limits.
        start: pose at ``start_time`` [rad] ``(joints,)``.
        start_time: [s].
        duration: time of sinking over the feet [s].
        tuck_time: from there to the belly [s].
    """
    legs, tucked = Legs(robot), tucked_pose(robot)
    abad = start[robot.leg_joints[:, 0]]
    x, z = legs.in_plane(start)
    highest = np.maximum(z, -legs.shortest)
    folded = legs.bent(abad, x, highest)
    return Motion(
        start_time,
        (duration, lambda share: legs.bent(abad, x, z + (highest - z) * _smooth(share))),
        (tuck_time, lambda share: folded + (tucked - folded) * _smooth(share)),
    )


class FootKey(NamedTuple):
    """Where the feet are at the end of a phase, and what they carry."""

    feet: FloatArray  # from the trunk's middle [m] ``(4, 3)``
    loads: FloatArray  # vertical forces [N] ``(4,)``
    duration: float  # time of the phase that ends here [s]
    airborne: tuple[int, ...] = ()  # legs that are lifted meanwhile


class FootMotion:
    """Feet that move from key to key while they carry the robot.

    The targets ask for the torques that carry the robot on the feet that stand, and for those that overcome
    the drives' damping: ``q + (tau + D dq/dt) / K``.

    Args:
        robot: geometry, mass and gains.
        keys: the first one is where the feet are at the start; its duration counts for nothing.
        start: targets at ``start_time`` [rad] ``(joints,)``.
        start_time: [s].

    Attributes:
        end_time: when the last key is reached [s].
    """

    def __init__(
        self, robot: RobotDescription, keys: Sequence[FootKey], start: FloatArray, start_time: float
    ) -> None:
        self._robot, self._legs = robot, Legs(robot)
        self._start_time, self._keys = start_time, keys
        self.end_time = start_time + sum(key.duration for key in keys[1:])
        self._jump = start - self._plan(start_time)

    def target(self, time: float) -> FloatArray:
        """Joint targets [rad] ``(joints,)`` at ``time`` [s]; the first phase fades out the first jump."""
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


def gather_motion(
    robot: RobotDescription, state: RobotState, start: FloatArray, start_time: float
) -> FootMotion:
    """Two steps that bring the feet to where they stand below a robot in its default pose.

    First one diagonal pair of feet is lifted and put down, then the other, at the height that the trunk has:
    no foot is dragged while it carries. The pair that carries better, whose line passes nearer below the
    trunk's middle, goes second. A rest on all feet ends the motion: the trunk may still drift a little.

    Args:
        robot: geometry, mass and gains.
        state: the robot's state, for the legs' places and the trunk's tilt.
        start: targets at ``start_time`` [rad] ``(joints,)``.
        start_time: [s].
    """
    legs = Legs(robot)
    natural = math.sqrt(robot.standing_height / GRAVITY)
    goal = legs.feet(robot.default_pose)
    feet = level_feet(legs, state.joint_position, state.quaternion)
    feet[:, 2] = feet[:, 2].min()  # a foot in the air is put down
    feet = legs.within_reach(feet, _LONGEST)
    keys = [FootKey(feet, legs.loads(feet, _EVERYONE), 0.0)]
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
    return FootMotion(robot, keys, start, start_time)


def rise_motion(
    robot: RobotDescription, start: FloatArray, start_time: float, tuck_time: float, rise_time: float
) -> FootMotion:
    """From wherever the legs of a lying robot are to the default pose.

    The legs are tucked beside the belly; then all of them turn under the hips and stretch, alike, so that the
    feet stay where they stand.

    Args:
        robot: geometry, mass and gains.
        start: targets at ``start_time`` [rad] ``(joints,)``.
        start_time: [s].
        tuck_time: [s].
        rise_time: [s].
    """
    legs = Legs(robot)
    tucked, folded, standing = (
        legs.feet(pose) for pose in (tucked_pose(robot), folded_pose(robot), robot.default_pose)
    )
    keys = (
        FootKey(tucked, np.zeros(len(tucked)), 0.0),
        FootKey(tucked, legs.loads(tucked, _EVERYONE), tuck_time),
        FootKey(folded, legs.loads(folded, _EVERYONE), 0.5 * rise_time),
        FootKey(standing, legs.loads(standing, _EVERYONE), 0.5 * rise_time),
    )
    return FootMotion(robot, keys, start, start_time)


def feet_apart(robot: RobotDescription, state: RobotState) -> float:
    """Greatest horizontal distance of a foot from its place in the default pose [m]."""
    legs = Legs(robot)
    feet = level_feet(legs, state.joint_position, state.quaternion)
    away = (feet - legs.feet(robot.default_pose))[:, :2]
    return float(np.hypot(away[:, 0], away[:, 1]).max())


def _distance_from_middle(feet: FloatArray, pair: tuple[int, int]) -> float:
    """How far the line through two feet passes from below the trunk's middle [m]."""
    (ax, ay), (bx, by) = feet[pair[0], :2].tolist(), feet[pair[1], :2].tolist()
    return abs(ax * by - ay * bx) / max(math.hypot(bx - ax, by - ay), 1e-9)


def _smooth(share: float) -> float:
    """From 0 to 1 with rest at both ends."""
    share = min(max(share, 0.0), 1.0)
    return share * share * (3.0 - 2.0 * share)
