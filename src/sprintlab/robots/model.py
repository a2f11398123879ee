"""The MuJoCo model of a robot, compiled from its description."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np

from sprintlab.core.checks import check_choice, check_positive, check_range
from sprintlab.core.errors import InvalidValueError, RobotModelError, printable
from sprintlab.robots.description import FloatArray, Link, RobotDescription, joint_kind, point_inertia
from sprintlab.robots.visuals import add_robot_visuals, add_scenery

COLLISION_MODES = ("feet", "full")
# Stiff from the first tenth of a millimetre.
CONTACT_IMPEDANCE = (0.95, 0.99, 0.001, 0.5, 2.0)
_SLIDE_ONLY = 3  # contact dimension: normal and two tangents, no torsion or rolling

# A pair collides when one geom's contype meets the other's conaffinity.
_GROUND_BIT, _ROBOT_BIT = 1, 2
COLLISION_GROUP, VISUAL_GROUP = 3, 2
_PITCH = (0.0, 1.0, 0.0)
_AXES = {"abad": (1.0, 0.0, 0.0), "hip": _PITCH, "knee": _PITCH, "waist": _PITCH}

if mujoco.get_mju_user_warning() is None:
    # By itself MuJoCo also writes warnings to MUJOCO_LOG.TXT in the folder where a command was started, and
    # through a link of that name into any file.
    mujoco.set_mju_user_warning(lambda text: print(f"MuJoCo: {printable(text)}", file=sys.stderr))


@dataclass(frozen=True, kw_only=True)
class ModelOptions:
    """How a robot's model is compiled."""

    timestep: float = 0.001  # physics step [s]
    # ``"feet"`` (foot spheres on the floor, nothing else) or ``"full"`` (feet, shanks, thighs and trunk
    # collide with the floor and with other legs)
    collisions: str = "feet"
    # whether MuJoCo's solver makes the contact of feet and floor; the plant has pads instead
    solver_feet: bool = True
    # time constant of contacts and of joint limits [s]; at least two time steps, below which MuJoCo would
    # silently soften it
    contact_time_constant: float = 0.004
    dry_friction: bool = True  # whether joints have dry friction (MuJoCo ``frictionloss``)
    joint_limits: bool = True  # whether joints and springs have hard limits
    visuals: bool = False  # whether the model carries what only cameras see
    # whether the shank hangs on its series spring, if the robot has one; else it is fixed to the knee carrier
    knee_spring: bool = True

    def __post_init__(self) -> None:
        check_positive("timestep", self.timestep, "s")
        check_range("timestep", self.timestep, 1e-5, 0.01, "s")
        check_choice("collisions", self.collisions, COLLISION_MODES)
        check_positive("contact_time_constant", self.contact_time_constant, "s")
        if self.contact_time_constant < 2.0 * self.timestep * (1.0 - 1e-9):
            allowed = f"must be at least two time steps, {2.0 * self.timestep:g} s"
            raise InvalidValueError("contact_time_constant", self.contact_time_constant, allowed)


def build_model(
    robot: RobotDescription,
    options: ModelOptions | None = None,
    amend: Callable[[mujoco.MjSpec], None] | None = None,
) -> mujoco.MjModel:
    """Compile the MuJoCo model of a robot standing over a flat floor.

    Bodies ``trunk``, ``{leg}_abad``, ``{leg}_thigh``, ``{leg}_shank`` and, with a knee spring, ``{leg}_knee``
    between the last two; joints ``root`` (free), the robot's joints and its springs, 4 or none; geoms
    ``floor``, ``{leg}_foot`` and, with full collisions, ``trunk``, ``{leg}_thigh``, ``{leg}_shank``; torque
    actuators in policy order; keyframe ``stand``. With a waist the rear legs hang on the body ``rear_trunk``,
    whose geom is named so. ``amend`` may change the model before it is compiled, e.g. put terrain in the
    floor's place.
    """
    options = options or ModelOptions()
    try:
        spec = robot_spec(robot, options)
        if amend is not None:
            amend(spec)
        return spec.compile()
    except ValueError as error:
        reason = " ".join(str(error).split())
        raise RobotModelError(f"robot {robot.name!r} does not compile: {reason}") from error


def robot_spec(robot: RobotDescription, options: ModelOptions) -> mujoco.MjSpec:
    """The editable form of ``build_model``: for adding sensors, cameras or terrain before compiling."""
    return _Builder(robot, options).spec


class _Builder:
    """Puts a robot's spec together."""

    def __init__(self, robot: RobotDescription, options: ModelOptions) -> None:
        self.robot, self.options, self.spec = robot, options, mujoco.MjSpec()
        self.full = options.collisions == "full"
        self.spec.modelname = robot.name
        self._set_options()
        floor = self.spec.worldbody.add_geom(
            name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=(0, 0, 0.05)
        )
        self._set_contact(floor, contype=_GROUND_BIT, conaffinity=0)
        trunk = self._add_trunk()
        for index in (0, 1):
            self._add_leg(trunk, index)
        rear = self._add_rear_trunk(trunk)
        for index in (2, 3):
            self._add_leg(rear, index)
        for joint in robot.joint_names:
            self._add_torque_actuator(joint)
        if options.visuals:
            add_scenery(self.spec)
            add_robot_visuals(self.spec, robot, VISUAL_GROUP)
        self.spec.add_key(name="stand", qpos=self._standing_position())

    def _set_options(self) -> None:
        option = self.spec.option
        option.timestep = self.options.timestep
        option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
        option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        self.spec.compiler.degree = False

    def _set_contact(self, geom: mujoco.MjsGeom, *, contype: int, conaffinity: int) -> None:
        geom.contype, geom.conaffinity, geom.condim = contype, conaffinity, _SLIDE_ONLY
        geom.friction[0] = self.robot.foot_friction
        geom.solref = (self.options.contact_time_constant, 1.0)
        geom.solimp = CONTACT_IMPEDANCE

    def _set_robot_collision(self, geom: mujoco.MjsGeom) -> None:
        """Let a geom collide with the floor and, with full collisions, with the other robot geoms."""
        contype, conaffinity = (_ROBOT_BIT, _GROUND_BIT | _ROBOT_BIT) if self.full else (0, _GROUND_BIT)
        self._set_contact(geom, contype=contype, conaffinity=conaffinity)
        geom.group = COLLISION_GROUP if self.options.visuals else 0
        geom.rgba = (0.2, 0.6, 0.9, 0.4)

    def _add_trunk(self) -> mujoco.MjsBody:
        """The trunk, or its front half."""
        trunk = self.spec.worldbody.add_body(name="trunk", pos=(0, 0, self.robot.standing_height))
        trunk.add_freejoint(name="root")
        _set_link(trunk, self.robot.mechanics.trunk)
        self._add_trunk_box(trunk, 1.0)
        return trunk

    def _add_rear_trunk(self, trunk: mujoco.MjsBody) -> mujoco.MjsBody:
        """The body that carries the rear legs: the trunk itself where it has no waist."""
        if self.robot.mechanics.rear_trunk is None or self.robot.waist is None:
            return trunk
        rear = trunk.add_body(name="rear_trunk")
        _set_link(rear, self.robot.mechanics.rear_trunk)
        self._add_joint(rear, self.robot.waist)
        self._add_trunk_box(rear, -1.0)
        return rear

    def _add_trunk_box(self, body: mujoco.MjsBody, front: float) -> None:
        """The trunk's collision box; with a waist, the half before it (``front`` 1) or behind it (-1)."""
        if not self.full:
            return
        length, width, height = self.robot.mechanics.trunk_half_size
        middle = 0.0
        if self.robot.waist is not None:
            length, middle = 0.5 * length, 0.5 * front * length
        geom = body.add_geom(name=body.name, type=mujoco.mjtGeom.mjGEOM_BOX, size=(length, width, height))
        geom.pos = (middle, 0.0, 0.0)
        self._set_robot_collision(geom)

    def _add_leg(self, trunk: mujoco.MjsBody, index: int) -> None:
        leg, mechanics = self.robot.leg_names[index], self.robot.mechanics
        front, side = leg_signs(leg)
        joints = self.robot.leg_joints[index]
        abad = trunk.add_body(name=f"{leg}_abad", pos=(front * mechanics.hip_x, side * mechanics.hip_y, 0))
        _set_link(abad, mechanics.abad, side)
        self._add_joint(abad, joints[0])
        thigh = abad.add_body(name=f"{leg}_thigh", pos=(0, side * mechanics.abad_offset, 0))
        _set_link(thigh, mechanics.thigh, side)
        self._add_joint(thigh, joints[1])
        shank = self._add_shank(thigh, index)
        shank.mass, shank.ipos, inertia = shank_with_foot(self.robot, side)
        shank.explicitinertial, shank.fullinertia = True, _full_inertia(inertia)
        self._add_leg_collisions(leg, thigh, shank)

    def _add_shank(self, thigh: mujoco.MjsBody, index: int) -> mujoco.MjsBody:
        """The shank on its knee joint; with a series spring, on the carrier that the knee drives."""
        leg, mechanics = self.robot.leg_names[index], self.robot.mechanics
        knee, joint = (0, 0, -mechanics.thigh_length), self.robot.leg_joints[index, 2]
        if mechanics.knee_carrier is None:
            shank = thigh.add_body(name=f"{leg}_shank", pos=knee)
            self._add_joint(shank, joint)
            return shank
        carrier = thigh.add_body(name=f"{leg}_knee", pos=knee)
        _set_link(carrier, mechanics.knee_carrier)
        self._add_joint(carrier, joint)
        shank = carrier.add_body(name=f"{leg}_shank")
        if self.options.knee_spring:
            self._add_spring(shank, index)
        return shank

    def _add_joint(self, body: mujoco.MjsBody, index: int) -> None:
        robot = self.robot
        joint = body.add_joint(
            name=robot.joint_names[index],
            type=mujoco.mjtJoint.mjJNT_HINGE,
            axis=_AXES[joint_kind(robot.joint_names[index])],
            armature=float(robot.armature[index]),
        )
        joint.damping[0] = robot.viscous_friction[index]
        joint.frictionloss = float(robot.dry_friction[index]) if self.options.dry_friction else 0.0
        self._limit(joint, robot.position_limits[index])

    def _add_spring(self, body: mujoco.MjsBody, index: int) -> None:
        spring = self.robot.mechanics.knee_spring
        assert spring is not None
        name = self.robot.spring_joint_names[index]
        joint = body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=_AXES["knee"])
        joint.stiffness[0], joint.damping[0] = spring.stiffness, spring.damping
        joint.springref = spring.rest_angle
        self._limit(joint, spring.range)

    def _limit(self, joint: mujoco.MjsJoint, limits: object) -> None:
        if self.options.joint_limits:
            joint.limited, joint.range = mujoco.mjtLimited.mjLIMITED_TRUE, limits
            joint.solref_limit = (self.options.contact_time_constant, 1.0)
        else:
            joint.limited = mujoco.mjtLimited.mjLIMITED_FALSE

    def _add_leg_collisions(self, leg: str, thigh: mujoco.MjsBody, shank: mujoco.MjsBody) -> None:
        mechanics, radius = self.robot.mechanics, self.robot.foot_radius
        place = (0, 0, -mechanics.shank_length)
        foot = shank.add_geom(
            name=f"{leg}_foot", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=(radius, 0, 0), pos=place
        )
        self._set_robot_collision(foot)
        if not self.options.solver_feet:
            foot.conaffinity &= ~_GROUND_BIT
        if self.full:
            # The shank's capsule ends above the foot, which must touch the ground first.
            self._add_capsule(thigh, mechanics.thigh_radius, mechanics.thigh_length)
            self._add_capsule(shank, mechanics.shank_radius, mechanics.shank_length - radius)
            # The carrier between them hides from MuJoCo that thigh and shank are neighbours.
            self.spec.add_exclude(bodyname1=thigh.name, bodyname2=shank.name)

    def _add_capsule(self, body: mujoco.MjsBody, radius: float, length: float) -> None:
        geom = body.add_geom(name=body.name, type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=(radius, 0, 0))
        geom.fromto = (0, 0, 0, 0, 0, -length)
        self._set_robot_collision(geom)

    def _add_torque_actuator(self, joint: str) -> None:
        actuator = self.spec.add_actuator(name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        actuator.set_to_motor()
        actuator.ctrllimited = mujoco.mjtLimited.mjLIMITED_FALSE

    def _standing_position(self) -> list[float]:
        """Positions of the keyframe ``stand``: default pose, feet just on the ground, springs at rest."""
        robot, knee_spring = self.robot, self.robot.mechanics.knee_spring
        spring = [knee_spring.rest_angle] if knee_spring is not None and self.options.knee_spring else []
        position = [0.0, 0.0, robot.standing_height, 1.0, 0.0, 0.0, 0.0]
        waist = None if robot.waist is None else float(robot.default_pose[robot.waist])
        for leg, joints in zip(robot.leg_names, robot.leg_joints, strict=True):
            if waist is not None and leg_signs(leg)[0] < 0.0:
                position, waist = [*position, waist], None  # in the model's order: before the rear legs
            position += [*robot.default_pose[joints].tolist(), *spring]
        return position


def _set_link(body: mujoco.MjsBody, link: Link, side: float = 1.0) -> None:
    """Give a body its mass properties; ``side`` -1 mirrors y."""
    x, y, z = link.center_of_mass
    body.mass, body.ipos, body.explicitinertial = link.mass, (x, side * y, z), True
    if link.products_of_inertia is None:
        body.inertia = link.inertia
    else:
        body.fullinertia = _full_inertia(link.inertia_matrix(side))


def _full_inertia(matrix: FloatArray) -> tuple[float, ...]:
    """The six numbers of a symmetric matrix in MuJoCo's order: xx, yy, zz, xy, xz, yz."""
    return (*np.diag(matrix), matrix[0, 1], matrix[0, 2], matrix[1, 2])


def leg_signs(leg: str) -> tuple[float, float]:
    """``(+1 front | -1 rear, +1 left | -1 right)`` of a leg named ``FL``, ``FR``, ``RL`` or ``RR``."""
    return (1.0 if leg[0] == "F" else -1.0), (1.0 if leg[1] == "L" else -1.0)


def shank_with_foot(robot: RobotDescription, side: float = 1.0) -> tuple[float, FloatArray, FloatArray]:
    """Shank and foot as one rigid body, by the parallel-axis theorem; ``side`` -1 mirrors y.

    Returns:
        mass [kg], centre of mass ``(3,)`` [m] and inertia about it ``(3, 3)`` [kg m^2], in the shank's frame.
    """
    shank = robot.mechanics.shank
    foot = np.array((0.0, 0.0, -robot.mechanics.shank_length))
    foot_mass, radius = robot.mechanics.foot_mass, robot.foot_radius
    center = np.array(shank.center_of_mass) * (1.0, side, 1.0)
    common = (shank.mass * center + foot_mass * foot) / (shank.mass + foot_mass)
    inertia = shank.inertia_matrix(side) + shank.mass * point_inertia(center - common)
    inertia += foot_mass * (0.4 * radius**2 * np.eye(3) + point_inertia(foot - common))
    return shank.mass + foot_mass, common, inertia
