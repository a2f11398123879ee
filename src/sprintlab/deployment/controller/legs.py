"""Where the feet of a robot are, which joint angles bring them there, and what carrying the robot takes."""

from __future__ import annotations

import math

import numpy as np

from sprintlab.deployment.interface import FloatArray
from sprintlab.robots import RobotDescription

GRAVITY = 9.81  # m/s^2

_STOP_RESERVE = 0.1  # rad kept between a folded joint and its end stop
_WEIGHT_FIRST = 10.0  # carrying the weight counts for more than carrying it level


class Legs:
    """Kinematics and statics of the four legs, feet as points.

    In the plane of a leg with thigh ``a``, shank ``b``, hip angle ``h`` and knee angle ``k`` the foot is at
    ``x = -(a sin h + b sin(h + k))``, ``z = -(a cos h + b cos(h + k))`` from the hip; the abduction turns
    this plane, at its offset, about the trunk's forward axis.

    Args:
        robot: link lengths, limits, mass.
    """

    def __init__(self, robot: RobotDescription) -> None:
        mechanics = robot.mechanics
        front, side = np.array([1.0, 1.0, -1.0, -1.0]), np.array([1.0, -1.0, 1.0, -1.0])
        self._a, self._b = mechanics.thigh_length, mechanics.shank_length
        self._offset = mechanics.abad_offset * side
        self._axes = np.stack((mechanics.hip_x * front, mechanics.hip_y * side, np.zeros(4)), axis=1)
        self._bend = np.sign(robot.default_pose.reshape(-1, 3)[:, 2])
        self._weight = GRAVITY * robot.total_mass
        folded = folded_pose(robot).reshape(-1, 3)[:, 2]
        self.shortest = np.sqrt(self._a**2 + self._b**2 + 2.0 * self._a * self._b * np.cos(folded))

    def in_plane(self, pose: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Feet from their hips in the planes of the legs: forward and up [m], each ``(4,)``."""
        _, hip, knee = pose.reshape(-1, 3).T
        x = -(self._a * np.sin(hip) + self._b * np.sin(hip + knee))
        z = -(self._a * np.cos(hip) + self._b * np.cos(hip + knee))
        return x, z

    def bent(self, abad: FloatArray, x: FloatArray, z: FloatArray) -> FloatArray:
        """Pose [rad] ``(12,)`` with abduction ``abad`` and the feet at ``x``, ``z`` in the legs' planes.

        What is out of reach comes as near as the legs can, in the same direction.
        """
        reach = np.clip(np.hypot(x, z), self.shortest, self._a + self._b)
        cosine = (reach**2 - self._a**2 - self._b**2) / (2.0 * self._a * self._b)
        knee = self._bend * np.arccos(np.clip(cosine, -1.0, 1.0))
        inner = np.arctan2(self._b * np.sin(knee), self._a + self._b * np.cos(knee))
        return np.stack((abad, np.arctan2(-x, -z) - inner, knee), axis=1).reshape(-1)

    def feet(self, pose: FloatArray) -> FloatArray:
        """Feet from the trunk's middle, in its axes [m] ``(4, 3)``."""
        abad = pose.reshape(-1, 3)[:, 0]
        x, z = self.in_plane(pose)
        y, up = (
            self._offset * np.cos(abad) - z * np.sin(abad),
            self._offset * np.sin(abad) + z * np.cos(abad),
        )
        return self._axes + np.stack((x, y, up), axis=1)

    def pose(self, feet: FloatArray) -> FloatArray:
        """Pose [rad] ``(12,)`` that has its feet at ``feet`` [m] ``(4, 3)``, in the trunk's axes."""
        x, y, up = (feet - self._axes).T
        z = -np.sqrt(np.maximum(y**2 + up**2 - self._offset**2, 0.0))
        turn = np.arctan2(up, y) - np.arctan2(z, self._offset)
        abad = (turn + math.pi) % (2.0 * math.pi) - math.pi
        return self.bent(abad, x, z)

    def within_reach(self, feet: FloatArray, share: float) -> FloatArray:
        """Feet [m] ``(4, 3)`` from the trunk's middle, raised where a leg would be longer than that share."""
        hips = feet - self._axes
        longest = (share * (self._a + self._b)) ** 2 + self._offset**2
        lowest = -np.sqrt(np.maximum(longest - hips[:, 0] ** 2 - hips[:, 1] ** 2, 0.0))
        hips[:, 2] = np.maximum(hips[:, 2], lowest)
        return hips + self._axes

    def loads(self, feet: FloatArray, standing: tuple[int, ...]) -> FloatArray:
        """Vertical forces [N] ``(4,)`` with which some of the feet carry a robot that is level.

        Least squares of weight, pitching and rolling moment about the trunk's middle; feet do not pull.
        """
        legs = list(standing)
        balance = np.stack((np.full(len(legs), _WEIGHT_FIRST), feet[legs, 0], feet[legs, 1]))
        wanted = np.array([_WEIGHT_FIRST * self._weight, 0.0, 0.0])
        forces = np.zeros(len(feet))
        forces[legs] = np.maximum(np.linalg.pinv(balance) @ wanted, 0.0)
        return forces

    def carrying_torque(self, pose: FloatArray, loads: FloatArray) -> FloatArray:
        """Joint torques [N m] ``(12,)`` that hold vertical ``loads`` [N] ``(4,)`` at the feet: ``-J' f``."""
        abad, hip, knee = pose.reshape(-1, 3).T
        x, _ = self.in_plane(pose)
        sideways = (self.feet(pose) - self._axes)[:, 1]
        shank = self._b * np.sin(hip + knee)
        rise = np.stack((sideways, -x * np.cos(abad), shank * np.cos(abad)), axis=1)
        return (-loads[:, None] * rise).reshape(-1)


def folded_pose(robot: RobotDescription) -> FloatArray:
    """Pose of a lying robot [rad] ``(12,)``: knees folded as far as is free, feet below the hips.

    With thigh ``a``, shank ``b`` and knee angle ``k`` the foot is below the hip for a hip angle
    ``atan2(-b sin k, a + b cos k)``.
    """
    a, b = robot.mechanics.thigh_length, robot.mechanics.shank_length
    reserve = robot.soft_stop.zone + _STOP_RESERVE
    poses = []
    for leg in range(len(robot.leg_names)):
        lower, upper = robot.position_limits[3 * leg + 2]
        bends_back = robot.default_pose[3 * leg + 2] < 0.0
        knee = float(lower) + reserve if bends_back else float(upper) - reserve
        hip = math.atan2(-b * math.sin(knee), a + b * math.cos(knee))
        poses.append((0.0, hip, knee))
    return np.asarray(poses, dtype=np.float64).reshape(-1)


def tucked_pose(robot: RobotDescription) -> FloatArray:
    """Pose of a robot on its belly [rad] ``(12,)``: knees folded, legs turned back.

    The feet are as high as the belly, or the hips as far as is free.
    """
    pose = folded_pose(robot).reshape(-1, 3)
    bend = np.sign(pose[:, 2])
    below = np.maximum(robot.mechanics.trunk_half_size[2] - robot.foot_radius, 0.0)
    hip = pose[:, 1] - bend * np.arccos(np.minimum(below / Legs(robot).shortest, 1.0))
    lower, upper = robot.position_limits.reshape(-1, 3, 2)[:, 1].T
    reserve = robot.soft_stop.zone + _STOP_RESERVE
    pose[:, 1] = np.clip(hip, lower + reserve, upper - reserve)
    return pose.reshape(-1)


def level_feet(legs: Legs, pose: FloatArray, quaternion: FloatArray) -> FloatArray:
    """Feet from the trunk's middle [m] ``(4, 3)``, forward along the heading, z along gravity.

    Args:
        legs: of the robot.
        pose: joint positions [rad] ``(12,)``.
        quaternion: of the trunk, w first.
    """
    w, x, y, z = quaternion.tolist()
    roll = math.atan2(2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y))
    pitch = -math.asin(min(1.0, max(-1.0, 2.0 * (x * z - w * y))))
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    levelled = np.array([[cp, sp * sr, sp * cr], [0.0, cr, -sr], [-sp, cp * sr, cp * cr]])
    return legs.feet(pose) @ levelled.T
