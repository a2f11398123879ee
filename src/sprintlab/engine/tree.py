"""What the tree is: a trunk, equal chains of hinges for legs and, where there is one, a waist between them.

Read from the compiled ``MjModel``, so that the robot is described once. Legs have the same joints about the
same coordinate axes; every number may differ from leg to leg. What the generator cannot express is refused
here, before anything is generated or compiled.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import mujoco
import numpy as np

from sprintlab.core.array_types import FloatArray
from sprintlab.core.errors import RobotModelError
from sprintlab.robots.description import point_inertia


@dataclass(frozen=True, kw_only=True, eq=False)
class RigidBody:
    """Mass properties of a body, in its own frame."""

    mass: float  # [kg]
    center: FloatArray  # centre of mass ``(3,)`` [m]
    inertia: FloatArray  # about the centre of mass ``(3, 3)`` [kg m^2]

    def about_origin(self) -> FloatArray:
        """Inertia about the frame's origin ``(3, 3)`` [kg m^2]."""
        return self.inertia + self.mass * point_inertia(self.center)

    def joined(self, other: RigidBody, offset: FloatArray) -> RigidBody:
        """This body and another one, fixed to it at ``offset``, as one."""
        mass, place = self.mass + other.mass, other.center + offset
        center = (self.mass * self.center + other.mass * place) / mass
        inertia = self.inertia + self.mass * point_inertia(self.center - center)
        inertia = inertia + other.inertia + other.mass * point_inertia(place - center)
        return RigidBody(mass=mass, center=center, inertia=inertia)


@dataclass(frozen=True, kw_only=True, eq=False)
class Link:
    """A body that moves on one hinge of its parent."""

    body: RigidBody  # its mass properties, with whatever is fixed to it
    position: FloatArray  # position of the hinge in the parent's frame ``(3,)`` [m]
    axis: int  # coordinate axis of the hinge, 0 to 2
    joint: str  # the hinge's name
    armature: float  # rotor inertia at the hinge [kg m^2]
    stiffness: float  # stiffness of a passive spring [N m/rad]
    damping: float  # viscous friction [N m s/rad]
    rest: float  # angle at which the spring gives nothing [rad]
    qpos: int  # addresses in MuJoCo's state
    qvel: int  # addresses in MuJoCo's state


@dataclass(frozen=True, kw_only=True, eq=False)
class Leg:
    """A chain of links from the trunk to a foot."""

    links: tuple[Link, ...]  # from the trunk outward
    foot: FloatArray  # middle of the foot's sphere in the last link's frame ``(3,)`` [m]
    radius: float  # radius of that sphere [m]
    rear: bool  # whether the leg hangs on the rear trunk, behind the waist


@dataclass(frozen=True, kw_only=True, eq=False)
class Tree:
    """A robot as the generator sees it."""

    trunk: RigidBody  # the free body, or the front half of it
    waist: Link | None  # the rear half, on its hinge; None where the trunk is one body
    legs: tuple[Leg, ...]  # four, with as many links each
    nq: int  # sizes of MuJoCo's state
    nv: int  # sizes of MuJoCo's state

    def column(self, name: str) -> FloatArray:
        """A number of every link, ``(legs, links)``."""
        return np.array([[getattr(link, name) for link in leg.links] for leg in self.legs])


def read_tree(model: mujoco.MjModel) -> Tree:
    """The tree of a compiled model.

    Raises:
        RobotModelError: the model is not a trunk with four equal legs; the message says why.
    """
    free = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
    _require(len(free) == 1, "the robot needs one free joint, its trunk's")
    trunk = int(model.jnt_bodyid[free[0]])
    heads = _children(model, trunk)
    branching = [body for body in heads if len(_children(model, body)) > 1]
    _require(len(branching) < 2, "the engine knows one waist, and the trunk has two branching children")
    waist = _read_link(model, branching[0]) if branching else None
    fronts = [_read_leg(model, body, rear=False) for body in heads if body not in branching]
    rears = [_read_leg(model, body, rear=True) for part in branching for body in _children(model, part)]
    tree = Tree(trunk=_read_body(model, trunk), waist=waist, legs=(*fronts, *rears), nq=model.nq, nv=model.nv)
    _check_legs(tree)
    return tree


def _require(condition: bool, otherwise: str) -> None:
    if not condition:
        raise RobotModelError(f"the engine cannot simulate this robot: {otherwise}")


def _check_legs(tree: Tree) -> None:
    _require(len(tree.legs) == 4, f"it needs four legs, not {len(tree.legs)}")
    _require(len({len(leg.links) for leg in tree.legs}) == 1, "its legs have different numbers of joints")
    axes = tree.column("axis")
    _require(bool((axes == axes[0]).all()), "its legs' joints turn about different axes")
    _require(len({leg.radius for leg in tree.legs}) == 1, "its feet have different radii")


def _children(model: mujoco.MjModel, body: int) -> list[int]:
    return [child for child in range(1, model.nbody) if model.body_parentid[child] == body]


def _read_leg(model: mujoco.MjModel, body: int, rear: bool) -> Leg:
    links, place = [_read_link(model, body)], np.zeros(3)
    while children := _children(model, body):
        _require(len(children) == 1, f"{model.body(body).name} carries {len(children)} bodies, not one")
        body = children[0]
        if model.body_jntnum[body]:
            links.append(_read_link(model, body))
            place = np.zeros(3)
        else:
            place = place + model.body_pos[body]
            links[-1] = _with_fixed(links[-1], _read_body(model, body), place)
    feet = [
        geom
        for geom in range(model.ngeom)
        if model.geom_bodyid[geom] == body and model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_SPHERE
    ]
    _require(len(feet) == 1, f"{model.body(body).name} needs one sphere for a foot, not {len(feet)}")
    foot = place + model.geom_pos[feet[0]]
    return Leg(links=tuple(links), foot=foot, radius=float(model.geom_size[feet[0], 0]), rear=rear)


def _with_fixed(link: Link, body: RigidBody, place: FloatArray) -> Link:
    return replace(link, body=link.body.joined(body, place))


def _read_link(model: mujoco.MjModel, body: int) -> Link:
    name = model.body(body).name
    _require(int(model.body_jntnum[body]) == 1, f"{name} needs one joint")
    joint = int(model.body_jntadr[body])
    dof, angle = int(model.jnt_dofadr[joint]), int(model.jnt_qposadr[joint])
    _require(model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE, f"{name}'s joint is no hinge")
    _require(np.allclose(model.jnt_pos[joint], 0.0), f"{name}'s joint is not at its frame's origin")
    axis = int(np.argmax(model.jnt_axis[joint]))
    _require(np.allclose(model.jnt_axis[joint], np.eye(3)[axis]), f"{name}'s joint turns about no axis")
    return Link(
        body=_read_body(model, body),
        position=model.body_pos[body].copy(),
        axis=axis,
        joint=model.joint(joint).name,
        armature=float(model.dof_armature[dof]),
        stiffness=float(np.ravel(model.jnt_stiffness[joint])[0]),
        damping=float(np.ravel(model.dof_damping[dof])[0]),
        rest=float(model.qpos_spring[angle]),
        qpos=angle,
        qvel=dof,
    )


def _read_body(model: mujoco.MjModel, body: int) -> RigidBody:
    name, mass = model.body(body).name, float(model.body_mass[body])
    _require(mass > 0.0, f"{name} has a mass of {mass:g} kg, which must be positive")
    fixed = int(model.body_jntnum[body]) == 0 or model.jnt_type[model.body_jntadr[body]] != 0
    straight = np.allclose(model.body_quat[body], (1.0, 0.0, 0.0, 0.0))
    _require(not fixed or straight, f"{name} is turned against its parent in the model's zero pose")
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, model.body_iquat[body])
    axes = rotation.reshape(3, 3)
    return RigidBody(
        mass=mass,
        center=model.body_ipos[body].copy(),
        inertia=axes @ np.diag(model.body_inertia[body]) @ axes.T,
    )
