"""The simulated robot of evaluation with Drake's physics under it."""

from __future__ import annotations

import mujoco
import numpy as np

from sprintlab.core.array_types import FloatArray
from sprintlab.plant.drake.assembly import rotors_of
from sprintlab.plant.drake.engine import DrakeEngine
from sprintlab.plant.plant import Plant, PlantOptions
from sprintlab.plant.settings import TrialSettings
from sprintlab.robots import RobotDescription


class DrakePlant(Plant):
    """One robot in Drake.

    Motor law, pads, end stops, measurements, trial settings and falls are those of ``Plant``. Dynamics,
    springs, joint friction, hard limits, contact between legs and time stepping are Drake's. ``data`` is a
    mirror of Drake's state, in which forces and recorders find the kinematics.

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
        self.engine = DrakeEngine(self.model, self._timestep, rotors=rotors_of(robot))
        self._force = np.zeros(self.model.nv)

    def _finish_step(self) -> None:
        self.engine.step(self._position, self._velocity, self._applied_force())
        self.data.time += self._timestep

    def _applied_force(self) -> FloatArray:
        """Generalized force ``(nv,)`` of motors, end stops, pads and air."""
        data, force = self.data, self._force
        force[:] = data.qfrc_applied
        force[self._joint_velocity] += data.ctrl
        for body in np.flatnonzero(data.xfrc_applied.any(axis=1)).tolist():
            push, twist = data.xfrc_applied[body, :3], data.xfrc_applied[body, 3:]
            mujoco.mj_applyFT(self.model, data, push, twist, data.xipos[body], body, force)
        return force
