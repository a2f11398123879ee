"""What a robot is, in numbers: joints, limits, motors, masses and lengths."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sprintlab.core.array_types import FloatArray
from sprintlab.core.checks import check_finite, check_positive, check_range
from sprintlab.core.errors import InvalidValueError
from sprintlab.motors import Battery, Gear, PmsmParameters

Vector = tuple[float, ...]

JOINTS_PER_LEG = ("abad", "hip", "knee")
WAIST = "waist"
"""An actuated joint between the front and the rear half of the trunk, about the trunk's y axis."""


@dataclass(frozen=True, kw_only=True)
class SoftStop:
    """Elastic end stop that acts only in the last ``zone`` before a joint's limits."""

    zone: float  # width of the zone inside each limit [rad]
    stiffness: float  # torque per depth in the zone [N m/rad]
    damping: float  # torque per joint velocity while in the zone [N m s/rad]


@dataclass(frozen=True, kw_only=True)
class KneeSpring:
    """Passive torsion spring in series between knee drive and shank."""

    stiffness: float  # [N m/rad]
    damping: float  # [N m s/rad]
    rest_angle: float  # deflection without load [rad]
    range: Vector  # lowest and highest deflection [rad]

    def __post_init__(self) -> None:
        check_range("knee_spring.rest_angle", self.rest_angle, *self.range, unit="rad")


@dataclass(frozen=True, kw_only=True)
class Link:
    """Mass properties of one rigid body, for a left leg; the right leg mirrors y."""

    mass: float  # [kg]
    center_of_mass: Vector = (0.0, 0.0, 0.0)  # (x, y, z) in the body's frame [m]
    inertia: Vector  # moments about the centre of mass along x, y, z [kg m^2]
    # (I_xy, I_xz, I_yz), off the diagonal of the inertia matrix [kg m^2]; none where x, y and z are principal
    # axes
    products_of_inertia: Vector | None = None

    def __post_init__(self) -> None:
        check_positive("mass", self.mass, "kg")
        check_finite("center_of_mass", np.asarray(self.center_of_mass))
        check_positive("inertia", np.asarray(self.inertia), "kg m^2")
        moments = np.linalg.eigvalsh(self.inertia_matrix())
        check_positive("principal moments of inertia", moments, "kg m^2")
        if 2.0 * moments.max() > moments.sum() * (1.0 + 1e-9):
            raise InvalidValueError("inertia", self.inertia, "no moment may exceed the sum of the other two")

    def inertia_matrix(self, side: float = 1.0) -> FloatArray:
        """Inertia about the centre of mass ``(3, 3)`` [kg m^2]; ``side`` -1 mirrors y."""
        xy, xz, yz = self.products_of_inertia or (0.0, 0.0, 0.0)
        products = np.array([[0.0, side * xy, xz], [side * xy, 0.0, side * yz], [xz, side * yz, 0.0]])
        return np.diag(self.inertia) + products


@dataclass(frozen=True, kw_only=True)
class Mechanics:
    """Masses and lengths from which the MuJoCo model is compiled (lengths in m)."""

    trunk: Link  # mass properties of the trunk
    trunk_half_size: Vector  # half lengths of the trunk's collision box (x, y, z)
    hip_x: float  # distance of an abduction axis from the trunk's middle along x
    hip_y: float  # distance of an abduction axis from the trunk's middle along y
    abad: Link  # link between abduction joint and hip joint
    abad_offset: float  # distance from the abduction axis to the leg's plane
    thigh: Link  # link between hip and knee
    thigh_length: float  # hip axis to knee axis
    thigh_radius: float  # radius of the thigh's collision capsule
    knee_carrier: Link | None  # light link between knee drive and series spring; None without a spring
    shank: Link  # link between spring and foot, without the foot
    shank_length: float  # knee axis to the middle of the foot sphere
    shank_radius: float  # radius of the shank's collision capsule
    foot_mass: float  # mass of the foot sphere [kg]
    # series spring between knee carrier and shank; None where the knee drives the shank
    knee_spring: KneeSpring | None
    # rear half of a trunk with a waist, which ``trunk`` then is the front half of: both in the trunk's axes,
    # the waist's axis through the origin; None where the trunk is one body
    rear_trunk: Link | None = None

    @property
    def leg_mass(self) -> float:
        """Mass of one leg, abduction link to foot [kg]."""
        links = (self.abad, self.thigh, self.knee_carrier, self.shank)
        return sum(link.mass for link in links if link is not None) + self.foot_mass


@dataclass(frozen=True, kw_only=True, eq=False)
class RobotDescription:
    """A quadruped, SI units; joints in the order ``FL, FR, RL, RR`` x ``abad, hip, knee``, then the waist."""

    name: str  # the robot's name
    leg_names: tuple[str, ...]  # 4 legs
    joint_names: tuple[str, ...]  # the ``J`` actuated joints, 12, or 13 with a waist
    spring_joint_names: tuple[str, ...]  # 4 passive joints, or none
    default_pose: FloatArray  # joint positions at zero action ``(J,)`` [rad]
    action_scale: FloatArray  # joint target per unit of action ``(J,)`` [rad]
    stiffness: FloatArray  # proportional gain of the joint controller ``(J,)`` [N m/rad]
    damping: FloatArray  # derivative gain of the joint controller ``(J,)`` [N m s/rad]
    position_limits: FloatArray  # lower and upper limit of each joint ``(J, 2)`` [rad]
    viscous_friction: FloatArray  # ``(J,)`` [N m s/rad]
    dry_friction: FloatArray  # ``(J,)`` [N m]
    motors: PmsmParameters  # motor parameters, motor side, each field ``(J,)``
    gear: Gear  # gear ratio and efficiency, each ``(J,)``
    bus_voltage: float  # [V]
    soft_stop: SoftStop  # end stops of the actuated joints
    base_height_target: float  # trunk height to run at [m]
    standing_height: float  # trunk height at which the feet touch the ground in the default pose [m]
    foot_radius: float  # [m]
    foot_friction: float  # sliding friction coefficient of a foot on the ground
    total_mass: float  # [kg]
    mechanics: Mechanics  # masses and lengths
    drag_area: float  # drag coefficient times frontal area [m^2]
    battery: Battery  # the pack that stands behind the bus where one is asked for

    def __post_init__(self) -> None:
        joints = len(self.joint_names)
        for field in ("default_pose", "action_scale", "stiffness", "damping"):
            self._freeze_array(field, (joints,))
        for field in ("viscous_friction", "dry_friction"):
            self._freeze_array(field, (joints,))
        self._freeze_array("position_limits", (joints, 2))
        self._check_pose_is_free()

    def _freeze_array(self, field: str, shape: tuple[int, ...]) -> None:
        array = np.array(getattr(self, field), dtype=np.float64)
        if array.shape != shape:
            raise InvalidValueError(field, array.shape, f"must have shape {shape}")
        check_finite(field, array)
        array.setflags(write=False)
        object.__setattr__(self, field, array)

    def _check_pose_is_free(self) -> None:
        lower, upper = self.position_limits.T
        for name, position, low, high in zip(self.joint_names, self.default_pose, lower, upper, strict=True):
            free = low + self.soft_stop.zone, high - self.soft_stop.zone
            check_range(f"default_pose[{name}]", position, *free, "rad")

    @property
    def armature(self) -> FloatArray:
        """Rotor inertia seen at the joints, ``ratio^2 J_rotor`` ``(J,)`` [kg m^2]."""
        return np.asarray(self.motors.rotor_inertia) * np.asarray(self.gear.ratio) ** 2

    @property
    def leg_joints(self) -> NDArray[np.int_]:
        """Which joints are abduction, hip and knee of each leg ``(legs, 3)``."""
        names = [[f"{leg}_{joint}" for joint in JOINTS_PER_LEG] for leg in self.leg_names]
        return np.array([[self.joint_names.index(name) for name in leg] for leg in names])

    @property
    def waist(self) -> int | None:
        """Which joint is the waist; None without one."""
        return self.joint_names.index(WAIST) if WAIST in self.joint_names else None

    @property
    def trunk_bodies(self) -> tuple[str, ...]:
        """Names of the bodies, and of the collision boxes, that the trunk consists of, front first."""
        return ("trunk",) if self.waist is None else ("trunk", "rear_trunk")


def point_inertia(position: FloatArray) -> FloatArray:
    """Inertia ``(3, 3)`` of a unit point mass at ``position`` about the origin [m^2]."""
    return float(position @ position) * np.eye(3) - np.outer(position, position)


def joint_kind(name: str) -> str:
    """``abad``, ``hip``, ``knee`` or ``waist``, of a joint's name."""
    return name.rpartition("_")[2]


def robot_fingerprint(robot: RobotDescription) -> str:
    """SHA-256 over every name and number of a robot: equal for equal robots, on every machine.

    Numbers count to twelve digits, because cosines differ in the last one between machines. A part that a
    robot does not have (a spring, products of inertia) leaves no trace, nor do air and battery, which no
    policy is made for.

    Returns:
        64 hexadecimal digits.
    """
    numbers = {name: value for name, value in _plain(robot).items() if name not in ("drag_area", "battery")}
    text = json.dumps(numbers, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode("utf-8")).hexdigest()


def _plain(value: Any) -> Any:
    """Names, and numbers as texts, so that 21 and 21.0 hash alike."""
    if is_dataclass(value):
        items = {field.name: getattr(value, field.name) for field in fields(value)}
        return {name: _plain(item) for name, item in items.items() if item is not None}
    if isinstance(value, str):
        return value
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    return [f"{number:.12g}" for number in np.asarray(value, dtype=np.float64).ravel()]
