"""The simulated robot of evaluation with Drake's physics under it: one time step is one step of Drake."""

# Drake's stubs take numpy's shapes for its element types, and MuJoCo's compiled module has no complete stubs.
# pyright: reportArgumentType=false, reportCallIssue=false, reportOperatorIssue=false

from __future__ import annotations

import math
from collections.abc import Mapping

import mujoco
import numpy as np
from pydrake.multibody.tree import default_model_instance

from sprintlab.core.array_types import FloatArray
from sprintlab.core.errors import SimulationError
from sprintlab.plant.drake.assembly import Rotor, assemble, rotors_of, without_remarks
from sprintlab.plant.plant import Plant
from sprintlab.plant.settings import PlantOptions, TrialSettings
from sprintlab.robots import RobotDescription


class DrakeEngine:
    """Advances the state of a robot; states and forces are in MuJoCo's coordinates.

    ``position`` is ``(nq,)``: base position, quaternion with w first, joints; ``velocity`` ``(nv,)``: base
    velocity in the world, angular velocity in the body, joints.

    A model without a free body has neither base position nor base velocity.

    Args:
        model: compiled model of one robot, with the changes of a trial.
        timestep: [s].
        rotors: by the names of the joints that have one.

    Raises:
        RobotModelError: the model cannot be translated.
    """

    def __init__(self, model: mujoco.MjModel, timestep: float, *, rotors: Mapping[str, Rotor]) -> None:
        self._diagram, self._plant = assemble(model, rotors, timestep)
        with without_remarks():
            self._root = self._diagram.CreateDefaultContext()
        self._context = self._plant.GetMyMutableContextFromRoot(self._root)
        self._bind(model)
        controllers = self._plant.get_desired_state_input_port(default_model_instance())
        if controllers.size():
            controllers.FixValue(self._context, np.zeros(controllers.size()))
        port = self._plant.get_applied_generalized_force_input_port()
        self._applied = port.FixValue(self._context, self._force)

    def _bind(self, model: mujoco.MjModel) -> None:
        """Where each number of MuJoCo's state stands in Drake's; a free body comes first in MuJoCo's."""
        joints = [model.joint(index) for index in range(model.njnt)]
        hinges = [joint for joint in joints if joint.type[0] == mujoco.mjtJoint.mjJNT_HINGE]
        self._joint_position = np.array([joint.qposadr[0] for joint in hinges], dtype=int)
        self._joint_velocity = np.array([joint.dofadr[0] for joint in hinges], dtype=int)
        own = [self._plant.GetJointByName(joint.name) for joint in hinges]
        self._own_position = np.array([joint.position_start() for joint in own], dtype=int)
        self._own_force = np.array([joint.velocity_start() for joint in own], dtype=int)
        self._own_velocity = self._plant.num_positions() + self._own_force
        self._state = np.zeros(self._plant.num_multibody_states())
        self._force = np.zeros(self._plant.num_velocities())
        self._floating = model.njnt > 0 and model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE
        if self._floating:
            base = self._plant.GetBodyByName(model.body(int(model.jnt_bodyid[0])).name)
            self._base_position = base.floating_positions_start()
            self._base_force = base.floating_velocities_start_in_v()
            self._base_velocity = self._base_force + self._plant.num_positions()

    def step(self, position: FloatArray, velocity: FloatArray, force: FloatArray) -> None:
        """Advance ``position`` and ``velocity`` by one time step, in place.

        Args:
            position: ``(nq,)``.
            velocity: ``(nv,)``.
            force: generalized force besides gravity, springs, joint friction and contact of legs and trunk
                ``(nv,)`` [N or N m].

        Raises:
            SimulationError: Drake's solver found no solution.
        """
        self._put_state(position, velocity)
        self._put_force(force, position)
        try:
            after = self._diagram.EvalUniquePeriodicDiscreteUpdate(self._root)
        except RuntimeError as error:
            raise SimulationError(f"Drake's step failed: {error}") from error
        self._root.SetDiscreteState(after)
        self._take_state(position, velocity)

    def _put_state(self, position: FloatArray, velocity: FloatArray) -> None:
        state = self._state
        if self._floating:
            base, moving = self._base_position, self._base_velocity
            state[base : base + 4] = position[3:7] / math.sqrt(position[3:7] @ position[3:7])
            state[base + 4 : base + 7] = position[:3]
            state[moving : moving + 3] = _to_world(position[3:7], velocity[3:6])
            state[moving + 3 : moving + 6] = velocity[:3]
        state[self._own_position] = position[self._joint_position]
        state[self._own_velocity] = velocity[self._joint_velocity]
        self._plant.SetPositionsAndVelocities(self._context, state)

    def _take_state(self, position: FloatArray, velocity: FloatArray) -> None:
        state = self._plant.GetPositionsAndVelocities(self._context)
        if self._floating:
            base, moving = self._base_position, self._base_velocity
            position[3:7] = state[base : base + 4]
            position[:3] = state[base + 4 : base + 7]
            velocity[3:6] = _to_body(position[3:7], state[moving : moving + 3])
            velocity[:3] = state[moving + 3 : moving + 6]
        position[self._joint_position] = state[self._own_position]
        velocity[self._joint_velocity] = state[self._own_velocity]

    def _put_force(self, force: FloatArray, position: FloatArray) -> None:
        own = self._force
        if self._floating:
            base = self._base_force
            own[base : base + 3] = _to_world(position[3:7], force[3:6])
            own[base + 3 : base + 6] = force[:3]
        own[self._own_force] = force[self._joint_velocity]
        self._applied.GetMutableData().get_mutable_value().SetFromVector(own)


class DrakePlant(Plant):
    """One robot in Drake.

    Motor law, pads, end stops, measurements, trial settings and falls are those of ``Plant``. Dynamics,
    springs, joint friction, hard limits, contact between legs and time stepping are Drake's. ``data`` is a
    mirror of Drake's state, in which forces and recorders find the kinematics.

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


def _to_world(quaternion: FloatArray, vector: FloatArray) -> FloatArray:
    result = np.zeros(3)
    mujoco.mju_rotVecQuat(result, vector, quaternion)
    return result


def _to_body(quaternion: FloatArray, vector: FloatArray) -> FloatArray:
    inverse, result = np.zeros(4), np.zeros(3)
    mujoco.mju_negQuat(inverse, quaternion)
    mujoco.mju_rotVecQuat(result, vector, inverse)
    return result
