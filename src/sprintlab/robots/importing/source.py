"""A quadruped read from an MJCF or URDF file: its legs found, every rigid part weighed.

MuJoCo reads both formats. Meshes are left out: masses and inertias must stand in the file.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from sprintlab.core.errors import RobotModelError
from sprintlab.robots.description import FloatArray, point_inertia
from sprintlab.robots.importing.compiling import compiled

JOINTS_OF_A_LEG = 3


@dataclass(frozen=True, kw_only=True)
class RigidPart:
    """Bodies that move as one, in the base's frame with all joints at zero."""

    bodies: tuple[str, ...]  # names
    mass: float  # [kg]
    center: FloatArray  # centre of mass ``(3,)`` [m]
    inertia: FloatArray  # about the centre of mass ``(3, 3)`` [kg m^2]


@dataclass(frozen=True, kw_only=True)
class SourceJoint:
    """A hinge of the source, in the base's frame with all joints at zero."""

    name: str  # in the source
    anchor: FloatArray  # a point of its axis ``(3,)`` [m]
    axis: FloatArray  # unit vector ``(3,)``
    limits: FloatArray | None  # lower and upper limit ``(2,)`` [rad]; None without
    armature: float  # [kg m^2]
    damping: float  # [N m s/rad]
    dry_friction: float  # [N m]
    effort: float | None  # greatest torque that the source states [N m]; None without


@dataclass(frozen=True, kw_only=True)
class SourceLeg:
    """Three hinges and the parts that they move, from the trunk outward."""

    joints: tuple[SourceJoint, ...]  # 3
    parts: tuple[RigidPart, ...]  # 3; the last one carries the foot
    foot: FloatArray  # middle of the foot ``(3,)`` [m]
    foot_radius: float  # [m]
    foot_mass: float | None  # mass of a body that is only the foot [kg]; None where shank and foot are one
    # radius of the collision shapes of thigh and shank [m]; None without shapes
    radii: tuple[float | None, ...]


@dataclass(frozen=True, kw_only=True)
class SourceRobot:
    """What a file says of a quadruped."""

    path: Path  # the file
    model: mujoco.MjModel  # the compiled source
    base: int  # index of the body that carries the trunk
    trunk: RigidPart  # what moves with the base
    trunk_half_size: FloatArray | None  # half sizes of its largest collision box ``(3,)`` [m]; None without
    legs: tuple[SourceLeg, ...]  # 4, in no particular order
    # links of a URDF whose inertia no body can have; it was raised to one that a body can
    corrected: tuple[str, ...]


def read_source(source: Path | SourceRobot, foot_radius: float | None = None) -> SourceRobot:
    """Read a quadruped with three hinges a leg.

    Args:
        source: MJCF or URDF; or one that was read already, which is not compiled again.
        foot_radius: for a robot whose feet have no sphere: the foot is the end of the shank's last body [m].

    Raises:
        RobotModelError: the file cannot be read, or is no quadruped with three hinges a leg; says which joint
            or body is in the way.
    """
    if isinstance(source, SourceRobot):
        path, model, corrected = source.path, source.model, source.corrected
    else:
        path, (model, corrected) = source, compiled(source)
    base = _base(model, path)
    data = posed(model, base, {})
    reader = _Reader(path, model, data, base, foot_radius)
    return SourceRobot(
        path=path,
        model=model,
        base=base,
        trunk=reader.part(reader.welded(base)),
        trunk_half_size=reader.box(reader.welded(base)),
        legs=reader.legs(),
        corrected=corrected,
    )


def posed(model: mujoco.MjModel, base: int, angles: dict[str, float]) -> mujoco.MjData:
    """The model with its base at the origin, the named hinges at their angles [rad], all others at zero.

    Positions and inertia only: no contacts, of which detailed shapes may have millions.
    """
    data = mujoco.MjData(model)
    data.qpos[:] = 0.0
    if model.body_jntnum[base]:
        data.qpos[model.jnt_qposadr[model.body_jntadr[base]] + 3] = 1.0
    for name, angle in angles.items():
        data.qpos[model.joint(name).qposadr[0]] = angle
    for step in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_tendon, mujoco.mj_makeM):
        step(model, data)
    return data


def _base(model: mujoco.MjModel, path: Path) -> int:
    """The body that floats, or else the outermost one that carries all hinges."""
    for joint in range(model.njnt):
        if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE:
            return int(model.jnt_bodyid[joint])
    roots = [body for body in range(1, model.nbody) if model.body_parentid[body] == 0]
    for body in roots:
        if not model.body_jntnum[body] and model.body_subtreemass[body] > 0.5 * model.body_subtreemass[0]:
            return body
    raise RobotModelError(f"robot model {path}: no body floats, so the trunk cannot be found")


class _Reader:
    """Takes a compiled model apart."""

    def __init__(
        self, path: Path, model: mujoco.MjModel, data: mujoco.MjData, base: int, foot_radius: float | None
    ) -> None:
        self._path, self._model, self._data, self._base = path, model, data, base
        self._foot_radius = foot_radius
        self._origin, self._frame = data.xpos[base].copy(), data.xmat[base].reshape(3, 3).copy()

    def refuse(self, reason: str) -> RobotModelError:
        """An error that names the file."""
        return RobotModelError(f"robot model {self._path}: {reason}")

    def _name(self, body: int) -> str:
        return self._model.body(body).name or f"body {body}"

    def _children(self, body: int) -> list[int]:
        parents = self._model.body_parentid
        return [child for child in range(1, self._model.nbody) if parents[child] == body and child != body]

    def welded(self, body: int) -> list[int]:
        """The body and all that hangs on it without a joint."""
        group = [body]
        for child in self._children(body):
            if self._model.body_jntnum[child] == 0:
                group += self.welded(child)
        return group

    def _jointed(self, group: list[int]) -> list[int]:
        """Bodies that hang on a group by joints."""
        return [child for body in group for child in self._children(body) if self._model.body_jntnum[child]]

    def _local(self, point: FloatArray) -> FloatArray:
        return self._frame.T @ (np.asarray(point) - self._origin)

    def part(self, group: list[int]) -> RigidPart:
        """Mass, centre of mass and inertia of a group."""
        model, data = self._model, self._data
        masses = model.body_mass[group]
        if masses.sum() <= 0.0:
            raise self.refuse(f"body {self._name(group[0])} has no mass")
        centers = np.array([self._local(data.xipos[body]) for body in group])
        center = masses @ centers / masses.sum()
        inertia = np.zeros((3, 3))
        for body, mass, place in zip(group, masses, centers, strict=True):
            turn = self._frame.T @ data.ximat[body].reshape(3, 3)
            offset = place - center
            inertia += turn @ np.diag(model.body_inertia[body]) @ turn.T
            inertia += mass * point_inertia(offset)
        names = tuple(self._name(body) for body in group)
        return RigidPart(bodies=names, mass=float(masses.sum()), center=center, inertia=inertia)

    def box(self, group: list[int]) -> FloatArray | None:
        """Half size of the largest collision box of a group."""
        sizes = [self._model.geom_size[geom] for geom in self._shapes(group, mujoco.mjtGeom.mjGEOM_BOX)]
        return max(sizes, key=lambda size: float(np.prod(size))).copy() if sizes else None

    def _shapes(self, group: list[int], kind: int) -> list[int]:
        model = self._model
        return [
            geom
            for geom in range(model.ngeom)
            if model.geom_bodyid[geom] in group and model.geom_type[geom] == kind
        ]

    def legs(self) -> tuple[SourceLeg, ...]:
        """The chains of three hinges on the base; refuses anything else."""
        starts = self._jointed(self.welded(self._base))
        if len(starts) != 4:
            names = ", ".join(self._name(body) for body in starts) or "none"
            raise self.refuse(f"{len(starts)} limbs hang on the trunk ({names}); a quadruped has 4")
        return tuple(self._leg(start) for start in starts)

    def _leg(self, start: int) -> SourceLeg:
        groups, joints, bodies = [], [], [start]
        while bodies:
            if len(bodies) > 1 or len(joints) == JOINTS_OF_A_LEG:
                raise self.refuse(
                    f"the limb at {self._name(start)} has more than three joints in a row "
                    f"(at {self._name(bodies[0])}); take out every body but hips and knees"
                )
            joints.append(self._joint(bodies[0]))
            groups.append(self.welded(bodies[0]))
            bodies = self._jointed(groups[-1])
        if len(joints) != JOINTS_OF_A_LEG:
            raise self.refuse(f"the limb at {self._name(start)} has {len(joints)} joints; a leg has 3")
        foot, radius, mass = self._foot(groups[-1])
        return SourceLeg(
            joints=tuple(joints),
            parts=tuple(self.part(group) for group in groups),
            foot=foot,
            foot_radius=radius,
            foot_mass=mass,
            radii=tuple(self._radius(group) for group in groups[1:]),
        )

    def _joint(self, body: int) -> SourceJoint:
        model, index = self._model, int(self._model.body_jntadr[body])
        name = model.joint(index).name or f"joint {index}"
        if model.body_jntnum[body] != 1 or model.jnt_type[index] != mujoco.mjtJoint.mjJNT_HINGE:
            raise self.refuse(f"body {self._name(body)} must hang on exactly one hinge")
        dof = model.jnt_dofadr[index]
        return SourceJoint(
            name=name,
            anchor=self._local(self._data.xanchor[index]),
            axis=self._frame.T @ self._data.xaxis[index],
            limits=model.jnt_range[index].copy() if model.jnt_limited[index] else None,
            armature=float(model.dof_armature[dof]),
            damping=float(model.dof_damping[dof]),
            dry_friction=float(model.dof_frictionloss[dof]),
            effort=self._effort(index),
        )

    def _effort(self, joint: int) -> float | None:
        """The joint's stated torque limit: the smallest of its own and its actuators'."""
        model = self._model
        stated = [float(model.jnt_actfrcrange[joint, 1])] if model.jnt_actfrclimited[joint] else []
        for actuator in range(model.nu):
            on_joint = model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_JOINT
            if on_joint and model.actuator_trnid[actuator, 0] == joint:
                torque = self._actuator_torque(actuator)
                stated += [] if torque is None else [torque]
        return min(stated, default=None)

    def _actuator_torque(self, actuator: int) -> float | None:
        """Greatest joint torque of an actuator: by its force range, or a motor's by its control range."""
        model = self._model
        gear = float(model.actuator_gear[actuator, 0])
        if model.actuator_forcelimited[actuator]:
            return gear * float(model.actuator_forcerange[actuator, 1])
        is_motor = (
            model.actuator_gaintype[actuator] == mujoco.mjtGain.mjGAIN_FIXED
            and model.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_NONE
        )
        if is_motor and model.actuator_ctrllimited[actuator]:
            gain = float(model.actuator_gainprm[actuator, 0])
            return gear * gain * float(model.actuator_ctrlrange[actuator, 1])
        return None

    def _foot(self, group: list[int]) -> tuple[FloatArray, float, float | None]:
        """Middle, radius and own mass of the foot: the sphere farthest from the knee."""
        knee = self._data.xpos[group[0]]
        spheres = self._shapes(group, mujoco.mjtGeom.mjGEOM_SPHERE)
        if spheres:
            geom = max(spheres, key=lambda item: float(np.linalg.norm(self._data.geom_xpos[item] - knee)))
            body, radius = int(self._model.geom_bodyid[geom]), float(self._model.geom_size[geom, 0])
            place = self._data.geom_xpos[geom]
        elif self._foot_radius is not None and len(group) > 1:
            body, radius = group[-1], self._foot_radius
            place = self._data.xpos[body]
        else:
            raise self.refuse(
                f"body {self._name(group[0])} has no sphere for a foot; add one, or give the foot radius "
                "where the foot is a body of its own"
            )
        own = float(self._model.body_mass[body]) if body != group[0] else None
        return self._local(place), radius, own

    def _radius(self, group: list[int]) -> float | None:
        kinds = (mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_CYLINDER)
        sizes = [
            float(self._model.geom_size[geom, 0]) for kind in kinds for geom in self._shapes(group, kind)
        ]
        return max(sizes) if sizes else None
