"""Keeps what a trial needs: raw copies while it runs, everything else computed at the end at once."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from sprintlab.commands import heading_angle, in_heading_frame, tilt_angle
from sprintlab.control import ESTIMATE_SIZE
from sprintlab.core.array_types import FloatArray
from sprintlab.evaluation.geometry import leg_distance
from sprintlab.evaluation.motor_steps import MotorSteps
from sprintlab.evaluation.results import Trajectory, require_finite
from sprintlab.motors import DriveOutput
from sprintlab.plant import STANCE_FORCE, Plant

_SHAPES = ("thigh", "shank", "foot")  # a sphere is a capsule whose axis has no length
_KEPT_SUPPLY = ("winding_temperature", "i2t_level")  # of ``SupplyState``, where they are not None


class Recorder:
    """Samples of one trial.

    Args:
        plant: that is simulated; it has not moved yet.
        capacity: greatest number of samples.
        estimates: whether ``estimate`` is set at every policy step and shall be kept.
    """

    def __init__(self, plant: Plant, capacity: int, estimates: bool = False) -> None:
        model = plant.model
        self._plant, self._robot = plant, plant.robot
        self._count = 0
        self.command = np.zeros(3)
        self.profile_speed = 0.0
        self.estimate: FloatArray | None = None
        legs, names = self._robot.leg_names, self._robot.joint_names
        self._joint_position = np.array([model.joint(name).qposadr[0] for name in names])
        self._joint_velocity = np.array([model.joint(name).dofadr[0] for name in names])
        self._feet = np.array([model.geom(f"{leg}_foot").id for leg in legs])
        self._shapes = np.array([[model.geom(f"{leg}_{name}").id for name in _SHAPES] for leg in legs])
        self._shape_size = model.geom_size[self._shapes, :2].copy()
        self._deepest, self._slid = [0.0] * len(legs), np.array(plant.pads.slid)
        shapes = self._motion_shapes(model) | self._supply_shapes()
        if estimates:
            shapes["estimate"] = (ESTIMATE_SIZE,)
        self._raw = {name: np.zeros((capacity, *shape)) for name, shape in shapes.items()}
        self._motor_steps = MotorSteps(plant, capacity * plant.options.record_every)

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
            "foot_penetration": (legs,),
            "foot_pressure": (legs,),
            "foot_slip_speed": (legs,),
            "shape_position": (*self._shapes.shape, 3),
            "shape_frame": (*self._shapes.shape, 9),
        }

    def _supply_shapes(self) -> dict[str, tuple[int, ...]]:
        """What is recorded of a battery and of windings, where they change."""
        state = self._plant.supply
        if state is None:
            return {}
        joints = (len(self._robot.joint_names),)
        kept = {name: joints for name in _KEPT_SUPPLY if getattr(state, name) is not None}
        return {"bus_voltage": (), **kept}

    def watch_step(self, data: mujoco.MjData) -> None:
        """Remember how deep the feet are and what they bear: an impact is over before the next sample."""
        deflection = self._plant.pads.deflection
        if any(deflection):
            self._deepest = [max(pair) for pair in zip(self._deepest, deflection, strict=True)]
        self._motor_steps.watch_step(data)

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
        raw["foot_position"][index] = positions[self._feet]
        raw["foot_pressure"][index] = self._plant.pads.normal_force
        raw["foot_penetration"][index] = np.maximum(self._deepest, self._plant.pads.deflection)
        self._deepest = [0.0] * len(self._deepest)
        slid = np.array(self._plant.pads.slid)
        raw["foot_slip_speed"][index] = (slid - self._slid) * self._plant.options.record_rate
        self._slid = slid
        raw["shape_position"][index] = positions[self._shapes]
        raw["shape_frame"][index] = data.geom_xmat[self._shapes]
        self._motor_steps.mark_sample()
        self._count += 1

    def _sample_supply(self, index: int) -> None:
        state = self._plant.supply
        if state is None:
            return
        self._raw["bus_voltage"][index] = state.bus_voltage
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
        trajectory = Trajectory(
            **_copied(raw),
            **self._base(raw),
            **self._joints(raw),
            **self._contacts(raw),
            **self._motor_steps.between_samples(),
        )
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
        return {
            "foot_contact": raw["foot_pressure"] > STANCE_FORCE,
            "leg_distance": self._leg_distance(raw),
        }

    def _leg_distance(self, raw: dict[str, FloatArray]) -> FloatArray:
        """Smallest surface distance between two legs ``(T,)``, from the axes of their capsules."""
        radius, half_length = self._shape_size[..., 0], self._shape_size[..., 1]
        axis = raw["shape_frame"][..., [2, 5, 8]] * half_length[..., None]
        start, end = raw["shape_position"] - axis, raw["shape_position"] + axis
        return leg_distance(start, end, radius)


def _copied(raw: dict[str, FloatArray]) -> dict[str, FloatArray]:
    """The arrays that are recorded as they are."""
    names = Trajectory.__dataclass_fields__
    return {name: values for name, values in raw.items() if name in names}
