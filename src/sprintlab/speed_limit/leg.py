"""One leg in the sagittal plane: thigh and shank on a hip that moves as the trunk carries it.

Coordinates x forward, z up, origin at the hip; hip angle ``q1`` and knee angle ``q2`` as on the robot,
positive about +y: a positive hip angle swings the leg backward. With ``a1 = q1``, ``a2 = q1 + q2`` and
``R(a) = [[cos a, sin a], [-sin a, cos a]]`` a point ``p`` of a link lies at ``R(a) p``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sprintlab.core.array_types import FloatArray
from sprintlab.core.constants import GRAVITY
from sprintlab.robots import RobotDescription
from sprintlab.robots.model import shank_with_foot


@dataclass(frozen=True, kw_only=True)
class PlanarLink:
    """A link of the leg, in its own frame with the origin on its upper joint."""

    length: float  # to the next joint or the foot's middle, along -z [m]
    mass: float  # [kg]
    center_x: float  # centre of mass [m]
    center_z: float  # centre of mass [m]
    inertia: float  # about the centre of mass, around y [kg m^2]


@dataclass(frozen=True, kw_only=True)
class PlanarLeg:
    """Thigh, shank with foot, and the rotors that the gears tie to hip and knee."""

    thigh: PlanarLink  # from hip to knee
    shank: PlanarLink  # from knee to foot, with the foot and, if there is one, the knee carrier
    armature: FloatArray  # reflected rotor inertia of hip and knee ``(2,)`` [kg m^2]
    foot_radius: float  # radius of the sphere that rolls on the ground [m]

    @property
    def reach(self) -> float:
        """Length of the straight leg [m]."""
        return self.thigh.length + self.shank.length


def planar_leg(robot: RobotDescription) -> PlanarLeg:
    """The sagittal plane of a robot's leg; its abduction stands still."""
    mechanics = robot.mechanics
    thigh = mechanics.thigh
    mass, center, inertia = shank_with_foot(robot)
    inertia_y = float(inertia[1, 1])
    if mechanics.knee_carrier is not None:
        carrier = mechanics.knee_carrier  # its centre is the knee axis
        total = mass + carrier.mass
        common = mass * center / total
        inertia_y += carrier.inertia[1] + mass * _squared(center - common) + carrier.mass * _squared(common)
        mass, center = total, common
    return PlanarLeg(
        thigh=PlanarLink(
            length=mechanics.thigh_length,
            mass=thigh.mass,
            center_x=thigh.center_of_mass[0],
            center_z=thigh.center_of_mass[2],
            inertia=thigh.inertia[1],
        ),
        shank=PlanarLink(
            length=mechanics.shank_length,
            mass=mass,
            center_x=float(center[0]),
            center_z=float(center[2]),
            inertia=inertia_y,
        ),
        armature=np.asarray(robot.armature[1:3]),
        foot_radius=robot.foot_radius,
    )


def _squared(offset: FloatArray) -> float:
    """Squared distance from the y axis [m^2]."""
    return float(offset[0] ** 2 + offset[2] ** 2)


Direction = tuple[FloatArray, FloatArray]
"""Cosine and sine of angles: what points of one link have in common."""


def _directions(position: FloatArray) -> tuple[Direction, Direction]:
    """Directions of thigh and shank for joint angles ``(..., 2)`` [rad]."""
    thigh = position[..., 0]
    shank = thigh + position[..., 1]
    return (np.cos(thigh), np.sin(thigh)), (np.cos(shank), np.sin(shank))


def _rotate(direction: Direction, x: float, z: float) -> FloatArray:
    """``R(angle) (x, z)``, shape ``(..., 2)``."""
    cosine, sine = direction
    turned = np.empty((*np.shape(cosine), 2))
    turned[..., 0] = x * cosine + z * sine
    turned[..., 1] = z * cosine - x * sine
    return turned


def knee_position(leg: PlanarLeg, position: FloatArray) -> FloatArray:
    """Knee ``(..., 2)`` [m] for joint angles ``(..., 2)`` [rad]."""
    return _rotate(_directions(position)[0], 0.0, -leg.thigh.length)


def foot_position(leg: PlanarLeg, position: FloatArray) -> FloatArray:
    """Middle of the foot ``(..., 2)`` [m] for joint angles ``(..., 2)`` [rad]."""
    thigh, shank = _directions(position)
    return _rotate(thigh, 0.0, -leg.thigh.length) + _rotate(shank, 0.0, -leg.shank.length)


def joint_position(leg: PlanarLeg, foot: FloatArray) -> FloatArray:
    """Joint angles ``(..., 2)`` [rad] that bring the foot to ``foot`` ``(..., 2)`` [m], knee bent backward.

    Where the foot is out of reach, the angles of the straight (or the tightest) leg in its direction.
    """
    thigh, shank = leg.thigh.length, leg.shank.length
    squared = _dot(foot, foot)
    cosine = (squared - thigh**2 - shank**2) / (2.0 * thigh * shank)
    knee = -np.arccos(np.clip(cosine, -0.9999, 0.9999))
    bend = np.arctan2(shank * np.sin(knee), thigh + shank * np.cos(knee))
    return np.stack((np.arctan2(-foot[..., 0], -foot[..., 1]) - bend, knee), axis=-1)


def foot_jacobian(leg: PlanarLeg, position: FloatArray) -> FloatArray:
    """Derivative of the foot's middle by the joint angles, ``(..., 2, 2)`` [m/rad]."""
    thigh, shank = _directions(position)
    by_shank = _rotate(shank, -leg.shank.length, 0.0)
    by_thigh = _rotate(thigh, -leg.thigh.length, 0.0)
    return np.stack((by_thigh + by_shank, by_shank), axis=-1)


def contact_jacobian(leg: PlanarLeg, position: FloatArray) -> FloatArray:
    """The same for the foot's lowest point, which a rolling foot holds still on the ground."""
    jacobian = foot_jacobian(leg, position)
    jacobian[..., 0, :] -= leg.foot_radius
    return jacobian


def stance_motion(
    leg: PlanarLeg, position: FloatArray, hip_velocity: FloatArray, hip_acceleration: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Joint velocity and acceleration ``(..., 2)`` of a leg whose foot rolls on the ground.

    The ground moves against the hip: ``J_c q' = -v_hip``, and its derivative ``J_c q'' = -J' q' - a_hip``.
    """
    thigh, shank = _directions(position)
    jacobian = contact_jacobian(leg, position)
    velocity = np.asarray(np.linalg.solve(jacobian, -hip_velocity[..., None])[..., 0], dtype=np.float64)
    turning = _rotate(thigh, 0.0, -leg.thigh.length) * velocity[..., :1] ** 2
    turning += _rotate(shank, 0.0, -leg.shank.length) * (velocity[..., :1] + velocity[..., 1:]) ** 2
    pulled = np.linalg.solve(jacobian, (turning - hip_acceleration)[..., None])[..., 0]
    return velocity, np.asarray(pulled, dtype=np.float64)


def mass_matrix(leg: PlanarLeg, position: FloatArray) -> FloatArray:
    """Inertia matrix of the leg on a fixed hip, rotors included, ``(..., 2, 2)`` [kg m^2]."""
    thigh, shank = _directions(position)
    own = _rotate(thigh, leg.thigh.center_z, -leg.thigh.center_x)
    carried = _rotate(shank, leg.shank.center_z, -leg.shank.center_x)
    knee_arm = _rotate(thigh, -leg.thigh.length, 0.0)
    by_thigh = leg.thigh.mass * _dot(own, own) + leg.thigh.inertia
    by_knee = leg.shank.mass * _dot(carried, carried) + leg.shank.inertia
    coupled = leg.shank.mass * _dot(knee_arm, carried)
    inertia = np.empty((*np.shape(by_knee), 2, 2))
    inertia[..., 0, 0] = (
        by_thigh + by_knee + 2.0 * coupled + leg.shank.mass * leg.thigh.length**2 + leg.armature[0]
    )
    inertia[..., 0, 1] = inertia[..., 1, 0] = by_knee + coupled
    inertia[..., 1, 1] = by_knee + leg.armature[1]
    return inertia


def inverse_dynamics(
    leg: PlanarLeg, position: FloatArray, velocity: FloatArray, acceleration: FloatArray
) -> FloatArray:
    """Torques ``(..., 2)`` [N m] that move the free leg, rotors included.

    Virtual work: ``tau_j = sum over links of m (c'' + g) . dc/dq_j + I a'' da/dq_j``, plus the rotors'
    ``G^2 J q_j''``.
    """
    directions = _directions(position)
    rates, accelerations = (
        (rate[..., :1], rate[..., :1] + rate[..., 1:]) for rate in (velocity, acceleration)
    )
    knee_arm = _rotate(directions[0], -leg.thigh.length, 0.0)
    knee = knee_arm * accelerations[0] - _rotate(directions[0], 0.0, -leg.thigh.length) * rates[0] ** 2
    torque = leg.armature * acceleration
    links = (leg.thigh, leg.shank)
    for link, direction, rate, spin in zip(links, directions, rates, accelerations, strict=True):
        arm = _rotate(direction, link.center_z, -link.center_x)
        pull = arm * spin - _rotate(direction, link.center_x, link.center_z) * rate**2
        turn = link.inertia * spin[..., 0]
        if link is leg.thigh:
            torque[..., 0] += link.mass * _dot(_lifted(pull), arm) + turn
        else:
            force = link.mass * _lifted(knee + pull)
            torque[..., 0] += _dot(force, knee_arm + arm) + turn
            torque[..., 1] += _dot(force, arm) + turn
    return torque


def _lifted(acceleration: FloatArray) -> FloatArray:
    """Acceleration against free fall."""
    return acceleration + np.array((0.0, GRAVITY))


def _dot(first: FloatArray, second: FloatArray) -> FloatArray:
    # Written out: NumPy sums pairs several times slower than it adds columns.
    return first[..., 0] * second[..., 0] + first[..., 1] * second[..., 1]
