"""What motors, gears and feet do in every motor step, and what that comes to between two samples."""

from __future__ import annotations

import mujoco
import numpy as np

from sprintlab.core.array_types import FloatArray
from sprintlab.motors import copper_loss, saturate
from sprintlab.plant import Plant

FORCE_WINDOW = 0.005
"""The greatest foot force is a mean over this time [s]."""


class MotorSteps:
    """Rows of up to ``capacity`` motor steps of a trial.

    A power that is sampled in phase with the policy reads wrong: a joint is fastest in the middle between two
    actions. So torques, distances and forces of every motor step are kept.
    """

    def __init__(self, plant: Plant, capacity: int) -> None:
        self._plant, robot = plant, plant.robot
        self._substeps, self._period = plant.options.substeps, 1.0 / plant.options.motor_rate
        self._position, self._velocity = plant.joint_addresses
        self._armature = plant.model.dof_armature[self._velocity].copy()
        joints, legs = len(robot.joint_names), len(robot.leg_names)
        widths = {"position": joints, "velocity": joints, "motor": joints, "joint": joints, "force": legs}
        if plant.supply is not None:
            widths["loss"] = joints
        self._rows = {name: np.zeros((capacity, width)) for name, width in widths.items()}
        self._start = plant.data.qpos[self._position], plant.data.qvel[self._velocity]
        self._force, self._steps, self._count = [0.0] * legs, 0, 0
        self._marks: list[int] = []

    def watch_step(self, data: mujoco.MjData) -> None:
        """Add the feet's forces of one physics step; at the end of a motor step, keep its row."""
        force = self._plant.pads.normal_force
        if any(force):
            self._force = [before + now for before, now in zip(self._force, force, strict=True)]
        self._steps += 1
        if self._steps % self._substeps:
            return
        rows, index = self._rows, self._count
        rows["position"][index] = data.qpos[self._position]
        rows["velocity"][index] = data.qvel[self._velocity]
        rows["motor"][index] = self._plant.drive_output.motor_torque
        rows["joint"][index] = data.ctrl
        rows["force"][index] = self._force
        if self._plant.supply is not None:
            rows["loss"][index] = self._plant.supply.copper_loss
        self._force = [0.0] * len(self._force)
        self._count += 1

    def mark_sample(self) -> None:
        """A sample was taken now."""
        self._marks.append(self._count)

    def between_samples(self) -> dict[str, FloatArray]:
        """Arrays of ``Trajectory`` over the motor steps since the last sample; the first has none."""
        if not self._marks or not self._marks[-1]:
            return {}
        rows = {name: values[: self._marks[-1]] for name, values in self._rows.items()}
        robot, force = self._plant.robot, rows["force"] / self._substeps
        moved, change = (
            np.diff(rows[name], axis=0, prepend=start[None])
            for name, start in zip(("position", "velocity"), self._start, strict=True)
        )
        speed, acceleration = moved / self._period, change / self._period  # means of a motor step
        copper = rows["loss"] if "loss" in rows else np.asarray(copper_loss(robot.motors, rows["motor"]))
        shaft = saturate(robot.motors, rows["motor"]) * speed * robot.gear.ratio
        return {
            "foot_force": self._mean(force),
            "foot_impact": self._largest(_running_mean(force, round(FORCE_WINDOW / self._period))),
            "gear_torque": self._largest(rows["joint"] - self._armature * acceleration),
            "joint_power": self._mean(rows["joint"] * speed),
            "copper_loss": self._mean(copper),
            "bus_power": self._mean(np.maximum((shaft + copper).sum(axis=1), 0.0)),
        }

    def _mean(self, values: FloatArray) -> FloatArray:
        count = np.diff(self._marks, prepend=0)
        total = np.add.reduceat(values, self._starts)
        return total / np.maximum(count, 1).reshape(-1, *[1] * (values.ndim - 1))

    def _largest(self, values: FloatArray) -> FloatArray:
        """The values of greatest magnitude."""
        highest, lowest = (of.reduceat(values, self._starts) for of in (np.maximum, np.minimum))
        return np.where(highest > -lowest, highest, lowest)

    @property
    def _starts(self) -> list[int]:
        """First motor step since the sample before, for each sample; the first sample takes that after it."""
        return [0, *self._marks[:-1]]


def _running_mean(values: FloatArray, count: int) -> FloatArray:
    """Mean over each row ``(T, n)`` and those before it, ``count`` in all; before the first is nothing."""
    total = np.cumsum(np.concatenate((np.zeros((count, values.shape[1])), values)), axis=0)
    return (total[count:] - total[:-count]) / count
