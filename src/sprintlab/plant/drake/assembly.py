"""The robot as a Drake ``MultibodyPlant``, built body by body from the numbers of its compiled model."""

# Drake's stubs take numpy's shapes for its element types, and MuJoCo's compiled module has no complete stubs.
# pyright: reportArgumentType=false

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from itertools import combinations
from typing import Any, NamedTuple

import mujoco
import numpy as np
from pydrake.geometry import (
    AddContactMaterial,
    Box,
    Capsule,
    CollisionFilterDeclaration,
    GeometrySet,
    HalfSpace,
    ProximityProperties,
    SceneGraph,
    Sphere,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import AddMultibodyPlant, CoulombFriction, MultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    PdControllerGains,
    RevoluteJoint,
    RevoluteSpring,
    RigidBody,
    RotationalInertia,
    SpatialInertia,
)
from pydrake.systems.framework import Diagram, DiagramBuilder

from sprintlab.core.array_types import FloatArray
from sprintlab.core.errors import RobotModelError
from sprintlab.robots import RobotDescription

LINK_STIFFNESS = 200e3
"""Contact stiffness of everything but the feet [N/m]; such a contact is a fall or an audit line."""

_LINK_DISSIPATION = 1.0  # [s/m]
_FLOOR_STIFFNESS = 1e12  # the foot's pad has all the compliance [N/m]
_STICTION_SPEED = 1e-4  # slip below which friction is still building up [m/s]
_FRICTION_SPEED = 1e-3  # the same for a joint's dry friction [rad/s]
_HOLD = 1e-3  # position gain that Drake wants of a controller [N m/rad]; friction limits its effort


class Rotor(NamedTuple):
    """What turns behind the gear of a joint."""

    inertia: float  # motor side [kg m^2]
    ratio: float  # motor speed over joint speed [-]


def rotors_of(robot: RobotDescription) -> dict[str, Rotor]:
    """The rotor of each joint, by the joint's name."""
    inertia, ratio = (
        np.asarray(values).tolist() for values in (robot.motors.rotor_inertia, robot.gear.ratio)
    )
    return dict(zip(robot.joint_names, map(Rotor, inertia, ratio), strict=True))


def assemble(
    model: mujoco.MjModel, rotors: Mapping[str, Rotor], timestep: float
) -> tuple[Diagram, MultibodyPlant]:
    """Build the bodies of a compiled model in Drake: what steps, and the robot's bodies, joints and forces.

    Masses, inertias, frames, friction, springs, ranges and shapes are the numbers of ``model``, and which
    shapes may touch is decided as ``model`` decides it. ``rotors`` takes the place of its armatures.

    Args:
        model: compiled model of one robot, with the changes of a trial.
        rotors: by the names of the joints that have one.
        timestep: Drake's time step [s].

    Raises:
        RobotModelError: the model has a joint or a shape that this translation does not know.
    """
    builder = DiagramBuilder()
    config = MultibodyPlantConfig(
        time_step=timestep,
        discrete_contact_approximation="lagged",
        contact_model="point",
        stiction_tolerance=_STICTION_SPEED,
        use_sampled_output_ports=False,
    )
    plant, scene_graph = AddMultibodyPlant(config, builder)
    plant.mutable_gravity_field().set_gravity_vector(model.opt.gravity)
    bodies = [plant.world_body()]
    for body in range(1, model.nbody):
        bodies.append(plant.AddRigidBody(model.body(body).name, _inertia(model, body)))
        _hang(plant, model, body, bodies)
    for joint, rotor in rotors.items():
        _add_rotor(plant, joint, rotor, model)
    with without_remarks():
        shapes = [_add_shape(plant, model, geom, bodies) for geom in range(model.ngeom)]
        plant.Finalize()
        _filter_collisions(scene_graph, model, shapes)
    return builder.Build(), plant


@contextmanager
def without_remarks() -> Iterator[None]:
    """Keep off the screen what Drake remarks on half spaces and deformable bodies: there are none."""
    logger = logging.getLogger("drake")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        logger.setLevel(level)


def _inertia(model: mujoco.MjModel, body: int) -> SpatialInertia:
    """Mass, centre of mass and inertia of a body."""
    axes = _rotation(model.body_iquat[body]).matrix()
    central = axes @ np.diag(model.body_inertia[body]) @ axes.T
    return SpatialInertia.MakeFromCentralInertia(
        mass=float(model.body_mass[body]),
        p_PScm_E=model.body_ipos[body],
        I_SScm_E=RotationalInertia(
            *np.diag(central), Ixy=central[0, 1], Ixz=central[0, 2], Iyz=central[1, 2]
        ),
    )


def _rotation(quaternion: FloatArray) -> RotationMatrix:
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, quaternion)
    return RotationMatrix.ProjectToRotationMatrix(matrix.reshape(3, 3))


def _hang(plant: MultibodyPlant, model: mujoco.MjModel, body: int, bodies: list[RigidBody]) -> None:
    """Hang a body on its parent: free, on a hinge, or fixed."""
    parent, child = bodies[int(model.body_parentid[body])], bodies[body]
    pose = RigidTransform(_rotation(model.body_quat[body]), model.body_pos[body])
    if model.body_jntnum[body] == 0:
        plant.WeldFrames(parent.body_frame(), child.body_frame(), pose)
        return
    joint = int(model.body_jntadr[body])
    kind = model.jnt_type[joint] if model.body_jntnum[body] == 1 else None
    if kind == mujoco.mjtJoint.mjJNT_HINGE:
        _add_hinge(plant, model, joint, parent, child, pose)
    elif kind != mujoco.mjtJoint.mjJNT_FREE:  # a body without a joint is free in Drake
        raise RobotModelError(f"body {child.name()!r}: the second engine knows free bodies and single hinges")


def _add_hinge(
    plant: MultibodyPlant,
    model: mujoco.MjModel,
    joint: int,
    parent: RigidBody,
    child: RigidBody,
    pose: RigidTransform,
) -> None:
    """A hinge with viscous friction and, where the model has them, hard limits and a spring."""
    name, anchor = model.joint(joint).name, RigidTransform(model.jnt_pos[joint])
    fixed = FixedOffsetFrame(f"{name}_fixed", parent.body_frame(), pose @ anchor)
    moving = FixedOffsetFrame(f"{name}_moving", child.body_frame(), anchor)
    damping = float(model.dof_damping[model.jnt_dofadr[joint]])
    hinge = plant.AddJoint(
        RevoluteJoint(name, plant.AddFrame(fixed), plant.AddFrame(moving), model.jnt_axis[joint], damping)
    )
    if model.jnt_limited[joint]:
        lower, upper = model.jnt_range[joint]
        hinge.set_position_limits([lower], [upper])
    if model.jnt_stiffness[joint] > 0.0:
        rest = float(model.qpos_spring[model.jnt_qposadr[joint]])
        plant.AddForceElement(RevoluteSpring(hinge, rest, float(model.jnt_stiffness[joint])))


def _add_rotor(plant: MultibodyPlant, name: str, rotor: Rotor, model: mujoco.MjModel) -> None:
    """Rotor behind its gear, and dry friction: a brake on the joint's speed whose effort is limited.

    The motor's torque is not among it: that is applied to the joint from outside.
    """
    friction = float(model.dof_frictionloss[model.joint(name).dofadr[0]])
    motor = plant.AddJointActuator(name, plant.GetJointByName(name), friction if friction > 0.0 else np.inf)
    motor.set_default_rotor_inertia(rotor.inertia)
    motor.set_default_gear_ratio(rotor.ratio)
    if friction > 0.0:
        motor.set_controller_gains(PdControllerGains(p=_HOLD, d=friction / _FRICTION_SPEED))


def _add_shape(plant: MultibodyPlant, model: mujoco.MjModel, geom: int, bodies: list[RigidBody]) -> Any:
    name, kind, size = model.geom(geom).name, model.geom_type[geom], model.geom_size[geom]
    stiffness = LINK_STIFFNESS
    if kind == mujoco.mjtGeom.mjGEOM_PLANE:
        shape, stiffness = HalfSpace(), _FLOOR_STIFFNESS
    elif kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        shape = Sphere(float(size[0]))
    elif kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        shape = Capsule(float(size[0]), float(2.0 * size[1]))
    elif kind == mujoco.mjtGeom.mjGEOM_BOX:
        shape = Box(*(2.0 * size).tolist())
    else:
        raise RobotModelError(f"geom {name!r}: the second engine knows plane, sphere, capsule and box")
    pose = RigidTransform(_rotation(model.geom_quat[geom]), model.geom_pos[geom])
    friction = float(model.geom_friction[geom, 0])
    surface = ProximityProperties()
    AddContactMaterial(
        dissipation=_LINK_DISSIPATION,
        point_stiffness=stiffness,
        friction=CoulombFriction(friction, friction),  # two equal ones give the same
        properties=surface,
    )
    return plant.RegisterCollisionGeometry(bodies[model.geom_bodyid[geom]], pose, shape, name, surface)


def _filter_collisions(scene_graph: SceneGraph, model: mujoco.MjModel, shapes: list[Any]) -> None:
    """Let touch what may touch in the compiled model, and nothing else."""
    manager = scene_graph.collision_filter_manager()
    manager.Apply(CollisionFilterDeclaration().AllowWithin(GeometrySet(shapes)))
    for first, second in combinations(range(model.ngeom), 2):
        if not _may_touch(model, first, second):
            one, other = GeometrySet(shapes[first]), GeometrySet(shapes[second])
            manager.Apply(CollisionFilterDeclaration().ExcludeBetween(one, other))


def _may_touch(model: mujoco.MjModel, first: int, second: int) -> bool:
    """Whether MuJoCo would let two geoms collide: bits that match, on bodies apart."""
    bodies = [int(model.geom_bodyid[geom]) for geom in (first, second)]
    welded = [int(model.body_weldid[body]) for body in bodies]
    if welded[0] == welded[1] or ((min(bodies) << 16) + max(bodies)) in model.exclude_signature:
        return False
    parents = [int(model.body_weldid[model.body_parentid[body]]) for body in welded]
    if 0 not in welded and (parents[0] == welded[1] or parents[1] == welded[0]):
        return False
    one_way = model.geom_contype[first] & model.geom_conaffinity[second]
    return bool(one_way | (model.geom_contype[second] & model.geom_conaffinity[first]))
