"""Where the feet of a robot are, which joint angles bring them there, and what carrying the robot takes."""

from __future__ import annotations

import math

import numpy as np

from sprintlab.core.constants import GRAVITY
from sprintlab.deployment.messages import FloatArray
from sprintlab.robots import RobotDescription, leg_signs

_STOP_RESERVE = 0.1  # rad kept between a folded joint and its end stop
_WEIGHT_FIRST = 10.0  # carrying the weight counts for more than carrying it level


class Legs:
    """Kinematics and statics of the legs, feet as points; a waist is straight in the poses that it gives.

    In the plane of a leg with thigh ``a``, shank ``b``, hip angle ``h`` and knee angle ``k`` the foot is at
    ``x = -(a sin h + b sin(h + k))``, ``z = -(a cos h + b cos(h + k))`` from the hip; the abduction turns
    this plane, at its offset, about the trunk's forward axis.
    """

    def __init__(self, robot: RobotDescription) -> None:
        mechanics = robot.mechanics
        front, side = np.array([leg_signs(leg) for leg in robot.leg_names]).T
        self._joints, self._waist = robot.leg_joints, robot.waist
        self._count, self._rear = len(robot.joint_names), front < 0.0
        self._a, self._b = mechanics.thigh_length, mechanics.shank_length
        self._offset = mechanics.abad_offset * side
        self._axes = np.stack((mechanics.hip_x * front, mechanics.hip_y * side, np.zeros_like(side)), axis=1)
        self._bend = np.sign(robot.default_pose[self._joints[:, 2]])
        self._weight = GRAVITY * robot.total_mass
        folded = folded_pose(robot)[self._joints[:, 2]]
        # Least distance of each foot from its hip in that plane [m] ``(legs,)``
        self.shortest = np.sqrt(self._a**2 + self._b**2 + 2.0 * self._a * self._b * np.cos(folded))

    def feet(self, pose: FloatArray) -> FloatArray:
        """Feet [m] ``(legs, 3)`` from the trunk's middle, in its axes, of a pose [rad] ``(joints,)``."""
        abad, hip, knee = pose[self._joints].T
        x = -(self._a * np.sin(hip) + self._b * np.sin(hip + knee))
        z = -(self._a * np.cos(hip) + self._b * np.cos(hip + knee))
        y = self._offset * np.cos(abad) - z * np.sin(abad)
        feet = self._axes + np.array((x, y, self._offset * np.sin(abad) + z * np.cos(abad))).T
        if self._waist is not None:
            c, s = math.cos(pose[self._waist]), math.sin(pose[self._waist])
            feet[self._rear] = feet[self._rear] @ np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])
        return feet

    def pose(self, feet: FloatArray) -> FloatArray:
        """Pose [rad] ``(joints,)`` that has its feet at ``feet`` [m] ``(legs, 3)``, in the trunk's axes.

        What is out of reach comes as near as the legs can, in the same direction.
        """
        a, b = self._a, self._b
        x, y, up = (feet - self._axes).T
        z = -np.sqrt(np.maximum(y**2 + up**2 - self._offset**2, 0.0))
        turn = np.arctan2(up, y) - np.arctan2(z, self._offset)
        reach = np.minimum(
            np.maximum(np.hypot(x, z), self.shortest), a + b
        )  # np.clip takes five times as long
        cosine = (reach**2 - a**2 - b**2) / (2.0 * a * b)
        knee = self._bend * np.arccos(np.minimum(np.maximum(cosine, -1.0), 1.0))
        hip = np.arctan2(-x, -z) - np.arctan2(b * np.sin(knee), a + b * np.cos(knee))
        return self._all_joints(np.array(((turn + math.pi) % (2.0 * math.pi) - math.pi, hip, knee)).T)

    def _all_joints(self, legs: FloatArray) -> FloatArray:
        """Numbers of the legs' joints ``(legs, 3)`` as those of all joints, zero at the waist."""
        joints = np.zeros(self._count)
        joints[self._joints] = legs
        return joints

    def loads(self, feet: FloatArray) -> FloatArray:
        """Vertical forces [N] ``(legs,)`` with which the feet carry a robot that is level.

        Least squares of weight, pitching and rolling moment about the trunk's middle; feet do not pull.
        """
        balance = np.stack((np.full(len(feet), _WEIGHT_FIRST), feet[:, 0], feet[:, 1]))
        wanted = np.array([_WEIGHT_FIRST * self._weight, 0.0, 0.0])
        return np.maximum(np.linalg.pinv(balance) @ wanted, 0.0)

    def carrying_torque(self, pose: FloatArray, loads: FloatArray) -> FloatArray:
        """Torques [N m] ``(joints,)`` that hold vertical ``loads`` [N] ``(legs,)`` at the feet: ``-J' f``.

        The robot is taken to be level; a waist holds itself.
        """
        abad, hip, knee = pose[self._joints].T
        _, sideways, _ = (self.feet(pose) - self._axes).T
        shank = self._b * np.sin(hip + knee)
        x = -(self._a * np.sin(hip) + shank)
        rise = np.stack((sideways, -x * np.cos(abad), shank * np.cos(abad)), axis=1)
        return self._all_joints(-loads[:, None] * rise)


def folded_pose(robot: RobotDescription) -> FloatArray:
    """Pose of a lying robot [rad] ``(joints,)``: knees folded as far as is free, feet below the hips.

    With thigh ``a``, shank ``b`` and knee angle ``k`` the foot is below the hip for a hip angle
    ``atan2(-b sin k, a + b cos k)``.
    """
    a, b = robot.mechanics.thigh_length, robot.mechanics.shank_length
    reserve = robot.soft_stop.zone + _STOP_RESERVE
    pose = np.zeros(len(robot.joint_names))
    for joints in robot.leg_joints:
        lower, upper = robot.position_limits[joints[2]]
        bends_back = robot.default_pose[joints[2]] < 0.0
        knee = float(lower) + reserve if bends_back else float(upper) - reserve
        pose[joints] = 0.0, math.atan2(-b * math.sin(knee), a + b * math.cos(knee)), knee
    return pose


def tucked_pose(robot: RobotDescription) -> FloatArray:
    """Pose of a robot on its belly [rad] ``(joints,)``: knees folded, legs turned back.

    The feet are as high as the belly, or the hips as far as is free.
    """
    pose = folded_pose(robot)
    _, hips, knees = robot.leg_joints.T
    bend = np.sign(pose[knees])
    below = np.maximum(robot.mechanics.trunk_half_size[2] - robot.foot_radius, 0.0)
    hip = pose[hips] - bend * np.arccos(np.minimum(below / Legs(robot).shortest, 1.0))
    lower, upper = robot.position_limits[hips].T
    reserve = robot.soft_stop.zone + _STOP_RESERVE
    pose[hips] = np.clip(hip, lower + reserve, upper - reserve)
    return pose
