"""Keeps what a trial needs: raw copies while it runs, everything else computed at the end at once."""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np
from numpy.typing import NDArray

from sprintlab.commands import heading_angle, in_heading_frame, tilt_angle
from sprintlab.control import ESTIMATE_SIZE
from sprintlab.core.array_types import FloatArray
from sprintlab.evaluation.geometry import leg_distance
from sprintlab.evaluation.results import Trajectory, require_finite
from sprintlab.motors import DriveOutput
from sprintlab.plant import RoughGround, SupplyState, foot_table
from sprintlab.robots import RobotDescription

_CAPSULES = ("thigh", "shank")
_KEPT_SUPPLY = ("winding_temperature", "i2t_level")  # of ``SupplyState``, where they are not None


class Recorder:
    """Samples of one trial.

    Args:
        model: the compiled model that is simulated.
        robot: its description.
        capacity: greatest number of samples.
        estimates: whether ``estimate`` is set at every policy step and shall be kept.
        supply: what to ask for battery and windings at every sample; ``None`` where they do not change.
        motor_rate: rate of the motor loop [Hz]; over one of its steps the gears' torques are averaged.
        rough: the ground, from which the feet's heights then count; ``None`` where it is even.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        robot: RobotDescription,
        capacity: int,
        estimates: bool = False,
        supply: Callable[[], SupplyState | None] | None = None,
        motor_rate: float = 1000.0,
        rough: RoughGround | None = None,
    ) -> None:
        self._robot = robot
        self._supply, self._rough = supply, rough
        self._count = 0
        self.command = np.zeros(3)
        self.profile_speed = 0.0
        self.estimate: FloatArray | None = None
        legs = robot.leg_names
        self._joint_position = np.array([model.joint(name).qposadr[0] for name in robot.joint_names])
        self._joint_velocity = np.array([model.joint(name).dofadr[0] for name in robot.joint_names])
        self._feet = np.array([model.geom(f"{leg}_foot").id for leg in legs])
        self._foot_z = 3 * self._feet + 2  # of all places of geoms in one row
        self._capsules = np.array([[model.geom(f"{leg}_{name}").id for name in _CAPSULES] for leg in legs])
        self._capsule_size = model.geom_size[self._capsules, :2].copy()
        self._shanks = np.array([model.body(f"{leg}_shank").id for leg in legs])
        self._trunk = model.body("trunk").id
        self._lowest_foot = np.full(len(legs), np.inf)
        self._loads = _Loads(model, robot, motor_rate)
        shapes = self._motion_shapes(model) | self._supply_shapes()
        if estimates:
            shapes["estimate"] = (ESTIMATE_SIZE,)
        self._raw = {name: np.zeros((capacity, *shape)) for name, shape in shapes.items()}

    def _motion_shapes(self, model: mujoco.MjModel) -> dict[str, tuple[int, ...]]:
        """What every trial records: name and shape of a sample."""
        joints, legs = (len(self._robot.joint_names),), len(self._robot.leg_names)
        return {
            "time": (),
            "profile_speed": (),
            "command": (3,),
            "qpos": (model.nq,),
            "qvel": (model.nv,),
            "joint_target": joints,
            "motor_torque": joints,
            "torque_lower": joints,
            "torque_upper": joints,
            "joint_torque": joints,
            "foot_position": (legs, 3),
            "lowest_foot": (legs,),
            "foot_force": (legs,),
            "gear_torque": joints,
            "shank_velocity": (legs, 6),
            "center_of_mass": (3,),
            "capsule_position": (*self._capsules.shape, 3),
            "capsule_frame": (*self._capsules.shape, 9),
        }

    def _supply_shapes(self) -> dict[str, tuple[int, ...]]:
        """What is recorded of a battery and of windings, where they change."""
        state = None if self._supply is None else self._supply()
        if state is None:
            return {}
        joints = (len(self._robot.joint_names),)
        kept = {name: joints for name in _KEPT_SUPPLY if getattr(state, name) is not None}
        return {"bus_voltage": (), "copper_loss": joints, **kept}

    def watch_step(self, data: mujoco.MjData) -> None:
        """Remember how low the feet are and what they bear: an impact is over before the next sample."""
        self._watch_feet(data)
        self._loads.watch_step(data)

    def _watch_feet(self, data: mujoco.MjData) -> None:
        places = data.geom_xpos
        height = places.take(self._foot_z) if self._rough is None else self._height(places[self._feet])
        np.minimum(self._lowest_foot, height, out=self._lowest_foot)

    def _height(self, feet: FloatArray) -> FloatArray:
        """Of places ``(..., 3)`` above the ground below them [m]."""
        return feet[..., 2] if self._rough is None else feet[..., 2] - self._rough.height(feet[..., :2])

    def sample(self, data: mujoco.MjData, drive: DriveOutput, targets: FloatArray) -> None:
        """Copy one sample. ``data`` must hold the kinematics of its present state (after ``mj_step1``)."""
        raw, index = self._raw, self._count
        raw["time"][index] = data.time
        raw["profile_speed"][index] = self.profile_speed
        raw["command"][index] = self.command
        if self.estimate is not None:
            raw["estimate"][index] = self.estimate
        raw["qpos"][index] = data.qpos
        raw["qvel"][index] = data.qvel
        raw["joint_target"][index] = targets
        raw["motor_torque"][index] = drive.motor_torque
        raw["torque_lower"][index] = drive.lower
        raw["torque_upper"][index] = drive.upper
        raw["joint_torque"][index] = drive.torque
        self._sample_supply(index)
        positions = data.geom_xpos
        self._watch_feet(data)
        raw["foot_force"][index], raw["gear_torque"][index] = self._loads.take()
        raw["foot_position"][index] = positions[self._feet]
        raw["lowest_foot"][index] = self._lowest_foot
        self._lowest_foot[:] = np.inf
        raw["shank_velocity"][index] = data.cvel[self._shanks]
        raw["center_of_mass"][index] = data.subtree_com[self._trunk]
        raw["capsule_position"][index] = positions[self._capsules]
        raw["capsule_frame"][index] = data.geom_xmat[self._capsules]
        self._count += 1

    def _sample_supply(self, index: int) -> None:
        state = None if self._supply is None else self._supply()
        if state is None:
            return
        self._raw["bus_voltage"][index] = state.bus_voltage
        self._raw["copper_loss"][index] = state.copper_loss
        for name in _KEPT_SUPPLY:
            value = getattr(state, name)
            if value is not None:
                self._raw[name][index] = value

    def trajectory(self) -> Trajectory:
        """Everything recorded so far.

        Raises:
            SimulationError: an array holds a value that is not finite; the message names it and the time.
        """
        raw = {name: values[: self._count] for name, values in self._raw.items()}
        trajectory = Trajectory(**_copied(raw), **self._base(raw), **self._joints(raw), **self._contacts(raw))
        require_finite(trajectory)
        return trajectory

    def _joints(self, raw: dict[str, FloatArray]) -> dict[str, FloatArray]:
        return {
            "joint_position": raw["qpos"][:, self._joint_position],
            "joint_velocity": raw["qvel"][:, self._joint_velocity],
        }

    def _base(self, raw: dict[str, FloatArray]) -> dict[str, FloatArray]:
        quaternion = raw["qpos"][:, 3:7]
        heading = np.unwrap(heading_angle(quaternion))
        return {
            "velocity": in_heading_frame(raw["qvel"], heading),
            "height": raw["qpos"][:, 2],
            "angular_velocity": raw["qvel"][:, 3:6],
            "tilt": tilt_angle(quaternion),
            "heading": heading,
        }

    def _contacts(self, raw: dict[str, FloatArray]) -> dict[str, NDArray]:
        radius = self._robot.foot_radius
        return {
            "foot_contact": self._height(raw["foot_position"]) < radius,
            "foot_penetration": np.maximum(radius - raw["lowest_foot"], 0.0),
            "foot_slip_speed": np.linalg.norm(_lowest_point_velocity(raw, radius)[..., :2], axis=-1),
            "leg_distance": self._leg_distance(raw),
        }

    def _leg_distance(self, raw: dict[str, FloatArray]) -> FloatArray:
        """Smallest surface distance between two legs ``(T,)``, from the axes of their capsules."""
        radius, half_length = self._capsule_size[..., 0], self._capsule_size[..., 1]
        axis = raw["capsule_frame"][..., [2, 5, 8]] * half_length[..., None]
        start, end = raw["capsule_position"] - axis, raw["capsule_position"] + axis
        return leg_distance(start, end, radius)


class _Loads:
    """What feet and gears bear between two samples, from every physics step."""

    def __init__(self, model: mujoco.MjModel, robot: RobotDescription, motor_rate: float) -> None:
        self._step = model.opt.timestep
        self._substeps = round(1.0 / (motor_rate * self._step))
        self._joints = np.array([model.joint(name).dofadr[0] for name in robot.joint_names])
        self._armature = model.dof_armature[self._joints].copy()
        self._leg = foot_table(model, robot)
        self._velocity = np.zeros(len(self._joints))
        self._force = [0.0] * len(robot.leg_names)
        self._torque = np.zeros(len(self._joints))
        self._steps = self._since_sample = 0

    def watch_step(self, data: mujoco.MjData) -> None:
        """Add the forces of one physics step; at the end of a motor step, the gears' torques."""
        self._steps += 1
        self._since_sample += 1
        if data.ncon:
            self._add_forces(data)
        if self._steps % self._substeps == 0:
            self._compare_torques(data)

    def _add_forces(self, data: mujoco.MjData) -> None:
        contacts, forces = data.contact, data.efc_force
        rows = contacts.efc_address.tolist()
        for (first, second), row in zip(contacts.geom.tolist(), rows, strict=True):
            leg = self._leg.item(first, second)
            if leg >= 0 and row >= 0:
                # An elliptic cone's first force is the normal one: the vertical one on level ground.
                self._force[leg] += forces.item(row)

    def _compare_torques(self, data: mujoco.MjData) -> None:
        velocity = data.qvel[self._joints]
        acceleration = (velocity - self._velocity) / (self._substeps * self._step)
        torque = data.ctrl - self._armature * acceleration
        self._torque = np.where(np.abs(torque) > np.abs(self._torque), torque, self._torque)
        self._velocity = velocity

    def take(self) -> tuple[FloatArray, FloatArray]:
        """Mean vertical force ``(legs,)`` [N], top gear torque ``(joints,)`` [N m] since the last call."""
        taken = np.array(self._force) / max(1, self._since_sample), self._torque
        self._force, self._torque = [0.0] * len(self._force), np.zeros_like(self._torque)
        self._since_sample = 0
        return taken


def _copied(raw: dict[str, FloatArray]) -> dict[str, FloatArray]:
    """The arrays that are recorded as they are."""
    names = Trajectory.__dataclass_fields__
    return {name: values for name, values in raw.items() if name in names}


def _lowest_point_velocity(raw: dict[str, FloatArray], radius: float) -> FloatArray:
    """World velocity ``(T, 4, 3)`` of the point of each foot that is nearest to the ground.

    MuJoCo's ``cvel`` is the spatial velocity (rotation first) about the robot's centre of mass.
    """
    point = raw["foot_position"] - np.array([0.0, 0.0, radius])
    lever = point - raw["center_of_mass"][:, None, :]
    rotation, translation = raw["shank_velocity"][..., :3], raw["shank_velocity"][..., 3:]
    return translation + np.cross(rotation, lever)
