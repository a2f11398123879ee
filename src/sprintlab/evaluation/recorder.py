"""Keeps what a trial needs: raw copies while it runs, everything else computed at the end at once."""

from __future__ import annotations

import mujoco
import numpy as np

from sprintlab.commands import heading_angle, in_heading_frame
from sprintlab.control import ESTIMATE_SIZE
from sprintlab.core.array_types import FloatArray
from sprintlab.evaluation.geometry import leg_distance
from sprintlab.evaluation.motor_steps import MotorSteps
from sprintlab.evaluation.results import Trajectory, require_finite
from sprintlab.motors import DriveOutput
from sprintlab.plant import STANCE_FORCE, MotionRecorder, Plant

_SHAPES = ("thigh", "shank", "foot")  # a sphere is a capsule whose axis has no length
_SUPPLY = ("winding_temperature", "i2t_level")  # fields of ``SupplyState``, where they are not None


class Recorder(MotionRecorder):
    """Samples of one trial.

    Args:
        plant: which has not moved yet.
        capacity: greatest number of samples.
        estimates: whether ``estimate`` is set at every policy step and shall be kept.
    """

    def __init__(self, plant: Plant, capacity: int, estimates: bool = False) -> None:
        model, robot = plant.model, plant.robot
        self._plant, self._count = plant, 0
        self.command = np.zeros(3)
        self.profile_speed = 0.0
        self.estimate: FloatArray | None = None
        legs, joints = len(robot.leg_names), (len(robot.joint_names),)
        self._joint_position, self._joint_velocity = plant.joint_addresses
        shapes = [[model.geom(f"{leg}_{name}").id for name in _SHAPES] for leg in robot.leg_names]
        self._shapes = np.array(shapes)
        self._shape_size = model.geom_size[self._shapes, :2].copy()
        self._deepest, self._slid = [0.0] * legs, np.array(plant.pads.slid)
        sizes: dict[str, tuple[int, ...]] = {
            "time": (), "profile_speed": (), "command": (3,), "qpos": (model.nq,), "qvel": (model.nv,),
            "joint_target": joints, "motor_torque": joints, "torque_lower": joints, "torque_upper": joints,
            "joint_torque": joints, "foot_penetration": (legs,), "foot_pressure": (legs,),
            "foot_slip_speed": (legs,), "shape_position": (*self._shapes.shape, 3),
            "shape_frame": (*self._shapes.shape, 9),
        }  # fmt: skip
        if plant.supply is not None:
            self._supply = [name for name in _SUPPLY if getattr(plant.supply, name) is not None]
            sizes |= {"bus_voltage": (), **dict.fromkeys(self._supply, joints)}
        if estimates:
            sizes["estimate"] = (ESTIMATE_SIZE,)
        self._raw = {name: np.zeros((capacity, *size)) for name, size in sizes.items()}
        self._motor_steps = MotorSteps(plant, capacity * plant.options.record_every)

    def watch_step(self, data: mujoco.MjData) -> None:
        """Remember how deep the feet are and what they bear: an impact is over before the next sample."""
        deflection = self._plant.pads.deflection
        if any(deflection):
            self._deepest = [max(pair) for pair in zip(self._deepest, deflection, strict=True)]
        self._motor_steps.watch_step(data)

    def sample(self, data: mujoco.MjData, drive: DriveOutput, targets: FloatArray) -> None:
        """Copy one sample. ``data`` must hold the kinematics of its present state (after ``mj_step1``)."""
        raw, index, pads = self._raw, self._count, self._plant.pads
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
        raw["foot_pressure"][index] = pads.normal_force
        raw["foot_penetration"][index] = np.maximum(self._deepest, pads.deflection)
        slid = np.array(pads.slid)
        raw["foot_slip_speed"][index] = (slid - self._slid) * self._plant.options.record_rate
        raw["shape_position"][index] = data.geom_xpos[self._shapes]
        raw["shape_frame"][index] = data.geom_xmat[self._shapes]
        if (supply := self._plant.supply) is not None:
            raw["bus_voltage"][index] = supply.bus_voltage
            for name in self._supply:
                raw[name][index] = getattr(supply, name)
        self._deepest, self._slid = [0.0] * len(self._deepest), slid
        self._motor_steps.mark_sample()
        self._count += 1

    def trajectory(self) -> Trajectory:
        """Everything recorded so far.

        Raises:
            SimulationError: an array holds a value that is not finite; the message names it and the time.
        """
        raw = {name: values[: self._count] for name, values in self._raw.items()}
        heading = np.unwrap(heading_angle(raw["qpos"][:, 3:7]))
        trajectory = Trajectory(
            **{name: values for name, values in raw.items() if name in Trajectory.__dataclass_fields__},
            velocity=in_heading_frame(raw["qvel"], heading),
            angular_velocity=raw["qvel"][:, 3:6],
            heading=heading,
            joint_position=raw["qpos"][:, self._joint_position],
            joint_velocity=raw["qvel"][:, self._joint_velocity],
            foot_contact=raw["foot_pressure"] > STANCE_FORCE,
            foot_position=raw["shape_position"][:, :, _SHAPES.index("foot")],
            leg_distance=self._leg_distance(raw),
            **self._motor_steps.between_samples(),
        )
        require_finite(trajectory)
        return trajectory

    def _leg_distance(self, raw: dict[str, FloatArray]) -> FloatArray:
        """Smallest surface distance between two legs ``(T,)``, from the axes of their capsules."""
        radius, half_length = self._shape_size[..., 0], self._shape_size[..., 1]
        axis = raw["shape_frame"][..., [2, 5, 8]] * half_length[..., None]
        start, end = raw["shape_position"] - axis, raw["shape_position"] + axis
        return leg_distance(start, end, radius)
