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
from sprintlab.robots.foot import (
    NOMINAL_FOOT,
    FootContact,
    add_foot_pair,
    effective_leg_mass,
    set_foot_contact,
)
from sprintlab.robots.visuals import add_robot_visuals, add_scenery

COLLISION_MODES = ("feet", "full")
INTEGRATORS = {
    "implicitfast": mujoco.mjtIntegrator.mjINT_IMPLICITFAST,
    "euler": mujoco.mjtIntegrator.mjINT_EULER,
}
# Of trunk, thighs and shanks, which have no pads: stiff from the first tenth of a millimetre.
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
    """How a robot's model is compiled.

    Attributes:
        timestep: physics step [s].
        collisions: ``"feet"`` (foot spheres on the floor, nothing else) or ``"full"`` (feet, shanks, thighs
            and trunk collide with the floor and with other legs).
        foot: stiffness and restitution of the feet on the floor.
        solver_feet: whether MuJoCo's solver makes the contact of feet and floor; the plant has pads instead.
        contact_time_constant: time constant of all other contacts and of joint limits [s]; at least two time
            steps, below which MuJoCo would silently soften it.
        integrator: ``"implicitfast"``, or ``"euler"`` with explicit joint damping (cheaper on a GPU).
        dry_friction: whether joints have dry friction (MuJoCo ``frictionloss``).
        joint_limits: whether joints and springs have hard limits.
        visuals: whether the model carries what only cameras see.
        knee_spring: whether the shank hangs on its series spring, if the robot has one; else it is fixed to
            the knee carrier.

    Raises:
        InvalidValueError: a field is out of range.
    """

    timestep: float = 0.001
    collisions: str = "feet"
    foot: FootContact = NOMINAL_FOOT
    solver_feet: bool = True
    contact_time_constant: float = 0.004
    integrator: str = "implicitfast"
    dry_friction: bool = True
    joint_limits: bool = True
    visuals: bool = False
    knee_spring: bool = True

    def __post_init__(self) -> None:
        check_positive("timestep", self.timestep, "s")
        check_range("timestep", self.timestep, 1e-5, 0.01, "s")
        check_choice("collisions", self.collisions, COLLISION_MODES)
        check_choice("integrator", self.integrator, tuple(INTEGRATORS))
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
    ``floor``, ``{leg}_foot`` and, with full collisions, ``trunk``, ``{leg}_thigh``, ``{leg}_shank``; one pair
    of floor and foot per leg, named like the foot, with the pad's contact; torque actuators in policy order;
    keyframe ``stand``. With a waist the rear legs hang on the body ``rear_trunk``, whose geom is named so.
    With visuals also the cameras ``side``, ``chase`` and ``front``, which travel with the trunk. ``amend``
    may change the model before it is compiled, e.g. put terrain in the floor's place.

    Raises:
        RobotModelError: MuJoCo refuses to compile the description.
    """
    options = options or ModelOptions()
    try:
        spec = robot_spec(robot, options)
        if amend is not None:
            amend(spec)
        model = spec.compile()
    except ValueError as error:
        reason = " ".join(str(error).split())
        raise RobotModelError(f"robot {robot.name!r} does not compile: {reason}") from error
    if options.solver_feet:
        set_foot_contact(model, options.foot, effective_leg_mass(model))
    return model


def robot_spec(robot: RobotDescription, options: ModelOptions) -> mujoco.MjSpec:
    """The editable form of ``build_model``: for adding sensors, cameras or terrain before compiling.

    The pads' contact depends on compiled quantities: after compiling, call ``set_foot_contact``.
    """
    spec = mujoco.MjSpec()
    spec.modelname = robot.name
    _set_options(spec, options)
    _add_floor(spec, robot, options)
    trunk = _add_trunk(spec, robot, options)
    _add_legs(spec, trunk, robot, 1.0, options)
    _add_legs(spec, _add_rear_trunk(trunk, robot, options), robot, -1.0, options)
    for leg in robot.leg_names if options.solver_feet else ():
        add_foot_pair(spec, f"{leg}_foot", robot.foot_friction)
    for joint in robot.joint_names:
        _add_torque_actuator(spec, joint)
    if options.visuals:
        add_scenery(spec)
        add_robot_visuals(spec, robot, VISUAL_GROUP)
    spec.add_key(name="stand", qpos=_standing_position(robot, options))
    return spec


def _set_options(spec: mujoco.MjSpec, options: ModelOptions) -> None:
    spec.option.timestep = options.timestep
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.integrator = INTEGRATORS[options.integrator]
    if options.integrator == "euler":
        spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_EULERDAMP
    spec.compiler.degree = False


def _add_floor(spec: mujoco.MjSpec, robot: RobotDescription, options: ModelOptions) -> None:
    floor = spec.worldbody.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=(0, 0, 0.05))
    _set_contact(floor, robot, options, contype=_GROUND_BIT, conaffinity=0)


def _set_contact(
    geom: mujoco.MjsGeom, robot: RobotDescription, options: ModelOptions, *, contype: int, conaffinity: int
) -> None:
    geom.contype, geom.conaffinity, geom.condim = contype, conaffinity, _SLIDE_ONLY
    geom.friction[0] = robot.foot_friction
    geom.solref = (options.contact_time_constant, 1.0)
    geom.solimp = CONTACT_IMPEDANCE


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


def _add_trunk(spec: mujoco.MjSpec, robot: RobotDescription, options: ModelOptions) -> mujoco.MjsBody:
    """The trunk, or its front half."""
    trunk = spec.worldbody.add_body(name="trunk", pos=(0, 0, robot.standing_height))
    trunk.add_freejoint(name="root")
    _set_link(trunk, robot.mechanics.trunk)
    _add_trunk_box(trunk, 1.0, robot, options)
    return trunk


def _add_rear_trunk(trunk: mujoco.MjsBody, robot: RobotDescription, options: ModelOptions) -> mujoco.MjsBody:
    """The body that carries the rear legs: the trunk itself where it has no waist."""
    if robot.mechanics.rear_trunk is None or robot.waist is None:
        return trunk
    rear = trunk.add_body(name="rear_trunk")
    _set_link(rear, robot.mechanics.rear_trunk)
    _add_joint(rear, robot, robot.waist, options)
    _add_trunk_box(rear, -1.0, robot, options)
    return rear


def _add_trunk_box(
    body: mujoco.MjsBody, front: float, robot: RobotDescription, options: ModelOptions
) -> None:
    """The trunk's collision box; with a waist, the half before it (``front`` 1) or behind it (-1)."""
    if options.collisions != "full":
        return
    length, width, height = robot.mechanics.trunk_half_size
    middle = 0.0
    if robot.waist is not None:
        length, middle = 0.5 * length, 0.5 * front * length
    geom = body.add_geom(name=body.name, type=mujoco.mjtGeom.mjGEOM_BOX, size=(length, width, height))
    geom.pos = (middle, 0.0, 0.0)
    _set_robot_collision(geom, robot, options)


def _set_robot_collision(geom: mujoco.MjsGeom, robot: RobotDescription, options: ModelOptions) -> None:
    """Let a geom collide with the floor and, with full collisions, with the other robot geoms."""
    full = options.collisions == "full"
    contype, conaffinity = (_ROBOT_BIT, _GROUND_BIT | _ROBOT_BIT) if full else (0, _GROUND_BIT)
    _set_contact(geom, robot, options, contype=contype, conaffinity=conaffinity)
    geom.group = COLLISION_GROUP if options.visuals else 0
    geom.rgba = (0.2, 0.6, 0.9, 0.4)


def _add_legs(
    spec: mujoco.MjSpec, trunk: mujoco.MjsBody, robot: RobotDescription, front: float, options: ModelOptions
) -> None:
    """All front (1) or rear (-1) legs."""
    for index, leg in enumerate(robot.leg_names):
        if leg_signs(leg)[0] == front:
            _add_leg(spec, trunk, robot, index, options)


def _add_leg(
    spec: mujoco.MjSpec, trunk: mujoco.MjsBody, robot: RobotDescription, index: int, options: ModelOptions
) -> None:
    leg, mechanics = robot.leg_names[index], robot.mechanics
    front, side = leg_signs(leg)
    joints = robot.leg_joints[index]
    abad = trunk.add_body(name=f"{leg}_abad", pos=(front * mechanics.hip_x, side * mechanics.hip_y, 0))
    _set_link(abad, mechanics.abad, side)
    _add_joint(abad, robot, joints[0], options)
    thigh = abad.add_body(name=f"{leg}_thigh", pos=(0, side * mechanics.abad_offset, 0))
    _set_link(thigh, mechanics.thigh, side)
    _add_joint(thigh, robot, joints[1], options)
    shank = _add_shank(thigh, robot, index, options)
    _set_shank_inertia(shank, robot, side)
    _add_leg_collisions(spec, thigh, shank, robot, options)


def _add_shank(
    thigh: mujoco.MjsBody, robot: RobotDescription, index: int, options: ModelOptions
) -> mujoco.MjsBody:
    """The shank on its knee joint; with a series spring, on the carrier that the knee drives."""
    leg, mechanics = robot.leg_names[index], robot.mechanics
    knee, joint = (0, 0, -mechanics.thigh_length), robot.leg_joints[index, 2]
    if mechanics.knee_carrier is None:
        shank = thigh.add_body(name=f"{leg}_shank", pos=knee)
        _add_joint(shank, robot, joint, options)
        return shank
    carrier = thigh.add_body(name=f"{leg}_knee", pos=knee)
    _set_link(carrier, mechanics.knee_carrier)
    _add_joint(carrier, robot, joint, options)
    shank = carrier.add_body(name=f"{leg}_shank")
    if options.knee_spring:
        _add_spring(shank, robot, index, options)
    return shank


def leg_signs(leg: str) -> tuple[float, float]:
    """``(+1 front | -1 rear, +1 left | -1 right)`` of a leg named ``FL``, ``FR``, ``RL`` or ``RR``."""
    return (1.0 if leg[0] == "F" else -1.0), (1.0 if leg[1] == "L" else -1.0)


def _add_joint(body: mujoco.MjsBody, robot: RobotDescription, index: int, options: ModelOptions) -> None:
    joint = body.add_joint(
        name=robot.joint_names[index],
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=_AXES[joint_kind(robot.joint_names[index])],
        armature=float(robot.armature[index]),
    )
    joint.damping[0] = robot.viscous_friction[index]
    joint.frictionloss = float(robot.dry_friction[index]) if options.dry_friction else 0.0
    _limit(joint, robot.position_limits[index], options)


def _add_spring(body: mujoco.MjsBody, robot: RobotDescription, index: int, options: ModelOptions) -> None:
    spring = robot.mechanics.knee_spring
    assert spring is not None
    joint = body.add_joint(
        name=robot.spring_joint_names[index], type=mujoco.mjtJoint.mjJNT_HINGE, axis=_AXES["knee"]
    )
    joint.stiffness[0], joint.springref, joint.damping[0] = (
        spring.stiffness,
        spring.rest_angle,
        spring.damping,
    )
    _limit(joint, spring.range, options)


def _limit(joint: mujoco.MjsJoint, limits: object, options: ModelOptions) -> None:
    if options.joint_limits:
        joint.limited, joint.range = mujoco.mjtLimited.mjLIMITED_TRUE, limits
        joint.solref_limit = (options.contact_time_constant, 1.0)
    else:
        joint.limited = mujoco.mjtLimited.mjLIMITED_FALSE


def _set_shank_inertia(body: mujoco.MjsBody, robot: RobotDescription, side: float) -> None:
    body.mass, body.ipos, inertia = shank_with_foot(robot, side)
    body.explicitinertial = True
    body.fullinertia = _full_inertia(inertia)


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


def _add_leg_collisions(
    spec: mujoco.MjSpec,
    thigh: mujoco.MjsBody,
    shank: mujoco.MjsBody,
    robot: RobotDescription,
    options: ModelOptions,
) -> None:
    leg, mechanics = thigh.name.split("_")[0], robot.mechanics
    foot = shank.add_geom(
        name=f"{leg}_foot",
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        size=(robot.foot_radius, 0, 0),
        pos=(0, 0, -mechanics.shank_length),
    )
    _set_robot_collision(foot, robot, options)
    if not options.solver_feet:
        foot.conaffinity &= ~_GROUND_BIT
    if options.collisions == "full":
        # The shank's capsule ends above the foot, which must touch the ground first.
        shank_end = mechanics.shank_length - robot.foot_radius
        _add_capsule(thigh, f"{leg}_thigh", mechanics.thigh_radius, mechanics.thigh_length, robot, options)
        _add_capsule(shank, f"{leg}_shank", mechanics.shank_radius, shank_end, robot, options)
        # The carrier between them hides from MuJoCo that thigh and shank are neighbours.
        spec.add_exclude(bodyname1=thigh.name, bodyname2=shank.name)


def _add_capsule(
    body: mujoco.MjsBody,
    name: str,
    radius: float,
    length: float,
    robot: RobotDescription,
    options: ModelOptions,
) -> None:
    geom = body.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=(radius, 0, 0))
    geom.fromto = (0, 0, 0, 0, 0, -length)
    _set_robot_collision(geom, robot, options)


def _add_torque_actuator(spec: mujoco.MjSpec, joint: str) -> None:
    actuator = spec.add_actuator(name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    actuator.set_to_motor()
    actuator.ctrllimited = mujoco.mjtLimited.mjLIMITED_FALSE


def _standing_position(robot: RobotDescription, options: ModelOptions) -> list[float]:
    """Positions of the keyframe ``stand``: default pose, feet just on the ground, springs at rest."""
    knee_spring = robot.mechanics.knee_spring
    spring = [knee_spring.rest_angle] if knee_spring is not None and options.knee_spring else []
    position = [0.0, 0.0, robot.standing_height, 1.0, 0.0, 0.0, 0.0]
    waist = None if robot.waist is None else float(robot.default_pose[robot.waist])
    for leg, joints in zip(robot.leg_names, robot.leg_joints, strict=True):
        if waist is not None and leg_signs(leg)[0] < 0.0:
            position, waist = [*position, waist], None  # in the model's order: before the rear legs
        position += [*robot.default_pose[joints].tolist(), *spring]
    return position
