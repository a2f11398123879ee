"""The simulated robot of evaluation with Drake's physics under it."""

from __future__ import annotations

import mujoco
import numpy as np

from sprintlab.core.array_types import FloatArray
from sprintlab.plant.drake.assembly import rotors_of
from sprintlab.plant.drake.engine import DrakeEngine
from sprintlab.plant.drake.pad import pad_for
from sprintlab.plant.plant import Plant, PlantOptions
from sprintlab.plant.settings import TrialSettings
from sprintlab.robots import RobotDescription
from sprintlab.robots.foot import effective_leg_mass


class DrakePlant(Plant):
    """One robot in Drake.

    Motor law, end stops, measurements, trial settings and falls are those of ``Plant``. Dynamics, springs,
    joint friction, hard limits, contact and time stepping are Drake's. ``data`` is a mirror for recorders: it
    holds Drake's state and the forces of Drake's ground on the feet.

    Args:
        robot: what to simulate.
        options: how; the time step is Drake's.
        settings: what differs from trial to trial.

    Raises:
        RobotModelError: the robot's model does not compile, or cannot be translated.
    """

    def __init__(self, robot: RobotDescription, options: PlantOptions, settings: TrialSettings) -> None:
        super().__init__(robot, options, settings)
        self._timestep = options.timestep
        feet = [f"{leg}_foot" for leg in robot.leg_names]
        self.engine = DrakeEngine(
            self.model,
            self._timestep,
            rotors=rotors_of(robot),
            feet=feet,
            pad=pad_for(options.foot, effective_leg_mass(self.model), self._timestep),
        )
        self._feet = np.array([self.model.geom(foot).id for foot in feet])
        self._leg_of = {int(foot): leg for leg, foot in enumerate(self._feet)}
        self._height = np.full(len(self._feet), np.inf)
        self._force = np.zeros(self.model.nv)

    def _finish_step(self) -> None:
        self._watch_touchdowns()
        forces = self.engine.step(self._position, self._velocity, self._applied_force())
        self.data.time += self._timestep
        self._show_forces(forces)

    def _applied_force(self) -> FloatArray:
        """Generalized force ``(nv,)`` of motors, end stops, and whatever pushes a body."""
        data, force = self.data, self._force
        force[:] = data.qfrc_applied
        force[self._joint_velocity] += data.ctrl
        for body in np.flatnonzero(data.xfrc_applied.any(axis=1)).tolist():
            push, twist = data.xfrc_applied[body, :3], data.xfrc_applied[body, 3:]
            mujoco.mj_applyFT(self.model, data, push, twist, data.xipos[body], body, force)
        return force

    def _watch_touchdowns(self) -> None:
        """Tell the engine of each foot that has come down since the last step, and how fast."""
        height = self.data.geom_xpos[self._feet, 2]
        radius = self.robot.foot_radius
        for leg in np.flatnonzero((height < radius) & (self._height >= radius)).tolist():
            sinking = (self._height[leg] - height[leg]) / self._timestep
            self.engine.touch_down(leg, float(sinking) if np.isfinite(sinking) else 0.0)
        self._height = height

    def _show_forces(self, forces: FloatArray) -> None:
        """Put the ground's forces on the feet ``(4, 3)`` where MuJoCo keeps its own."""
        data = self.data
        if data.ncon == 0:
            return
        data.efc_force[:] = 0.0
        contacts = data.contact
        rows, frames = contacts.efc_address, contacts.frame
        for index, (first, second) in enumerate(contacts.geom.tolist()):
            leg = self._leg_of.get(second, self._leg_of.get(first, -1))
            if leg >= 0 and rows[index] >= 0:
                side = 1.0 if second in self._leg_of else -1.0
                row = rows[index]
                data.efc_force[row : row + 3] = side * frames[index].reshape(3, 3) @ forces[leg]
