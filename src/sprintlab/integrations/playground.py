"""MuJoCo Playground (JAX): the motor law in place of its environments' position actuators.

``MotorStep`` is called like ``mjx_env.step`` of Playground, to which its environments hand the joints'
targets: the law is worked out in every physics step, inside of the compiled function.
"""

from __future__ import annotations

# pyright: reportMissingImports=false
from typing import Any

import jax
import mujoco
import numpy as np
from mujoco import mjx

from sprintlab.motors import MotorModel, drive_torque
from sprintlab.robots import JointMotors


class MotorStep:
    """Physics steps behind a PD loop on geared motors, which are found by the joints' names.

    Changes the model: its actuators become torques without limits, the joints' armature that of the rotors,
    their damping zero (it is the PD loop's). Put it on the device afterwards: ``mjx.put_model(model)``.

    Args:
        model: with one position or torque actuator per hinge joint.
        motors: by joint name, or one for all joints.
        stiffness: stiffness of the PD loop [N m/rad].
        damping: damping of the PD loop [N m s/rad].
        motor_model: one of ``sprintlab.motors.MOTOR_MODELS``.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        motors: JointMotors,
        stiffness: float,
        damping: float,
        motor_model: MotorModel = "refined",
    ) -> None:
        joints = model.actuator_trnid[:, 0]
        self.joint_names = tuple(model.joint(joint).name for joint in joints)
        self.motors = motors.ordered(self.joint_names)
        self._positions, self._velocities = model.jnt_qposadr[joints], model.jnt_dofadr[joints]
        self._stiffness, self._damping = stiffness, damping
        self._motor_model: MotorModel = motor_model
        values = motors.parameters(self.joint_names)
        model.actuator_gainprm[:, 0], model.actuator_biasprm[:] = 1.0, 0.0
        model.actuator_ctrllimited[:], model.actuator_forcelimited[:] = False, False
        model.jnt_actfrclimited[joints] = False
        model.dof_damping[self._velocities] = 0.0
        model.dof_armature[self._velocities] = values["rotor_inertia"] * np.square(values["gear_ratio"])

    def torque(self, data: mjx.Data, targets: jax.Array) -> jax.Array:
        """Torque that the motors give [N m] ``(joints,)`` for joint targets [rad] ``(joints,)``."""
        position, velocity = data.qpos[self._positions], data.qvel[self._velocities]
        wanted = self._stiffness * (targets - position) - self._damping * velocity
        motors = self.motors
        return drive_torque(
            motors.motor, motors.gear, wanted, velocity, motors.bus_voltage, self._motor_model
        ).torque

    def __call__(self, model: mjx.Model, data: mjx.Data, action: jax.Array, n_substeps: int = 1) -> mjx.Data:
        """As ``mjx_env.step``: hold the joints' targets [rad] for some physics steps."""

        def substep(data: Any, _: None) -> tuple[Any, None]:
            return mjx.step(model, data.replace(ctrl=self.torque(data, action))), None

        return jax.lax.scan(substep, data, (), n_substeps)[0]
