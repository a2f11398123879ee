"""The last gate before a command leaves: position, torque and envelope limits."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sprintlab.control import pd_torque
from sprintlab.deployment.messages import FloatArray, JointCommand, RobotState
from sprintlab.motors import PreparedDrive
from sprintlab.robots import RobotDescription


class GuardedServo(NamedTuple):
    """A servo command that keeps every limit: target [rad], gains, feedforward [N m], all ``(joints,)``."""

    target_position: FloatArray
    stiffness: FloatArray
    damping: FloatArray
    feedforward_torque: FloatArray


_BAND = np.array([[-1.0], [0.0], [1.0]])


class CommandGuard:
    """Keeps what is asked of the joints within their limits.

    Torque: the joint's law ``stiffness (target - position) - damping velocity`` is evaluated at the last
    state and clipped to the motors' envelope (refined model, measured speed and bus voltage, through the
    gear). Where it is clipped, *both gains are scaled* by the same factor: the command stays a spring and
    a damper about the same target, so that on a robot that has moved on since it never pushes the other way,
    as a shifted torque would. Position: in the last ``zone`` before a limit the torque towards the limit
    fades to zero, and targets beyond a limit are moved to it, their torque being carried as feedforward.

    An old state: within its ``age`` a motor alone can change its joint's speed by ``age`` times peak torque
    over reflected inertia. The envelope is then the hull of what is allowed at the measured speed and at both
    ends of that band, never beyond the peak torque; the robot's drives clip at the speed of the moment.
    """

    def __init__(self, robot: RobotDescription) -> None:
        self._drive = PreparedDrive(robot.motors, robot.gear, robot.bus_voltage)
        self._ratio = np.asarray(robot.gear.ratio)
        self._stiffness, self._damping = np.array(robot.stiffness), np.array(robot.damping)
        self._lower, self._upper = np.ascontiguousarray(robot.position_limits.T)
        self._zone = robot.soft_stop.zone
        self._highest_voltage = 1.25 * robot.bus_voltage
        acceleration = np.asarray(robot.motors.peak_torque) / np.asarray(robot.motors.rotor_inertia)
        self._band = acceleration / self._ratio * _BAND

    def _torque_interval(self, state: RobotState, age: float) -> tuple[FloatArray, FloatArray]:
        """Least and greatest joint torque [N m] ``(joints,)`` that may be asked for."""
        lower, upper = self._envelope(state, age)
        above = _share((self._upper - state.joint_position) / self._zone)
        below = _share((state.joint_position - self._lower) / self._zone)
        # Above its no-load speed a motor brakes whatever it is told: then the envelope overrules the stop.
        least = np.minimum(np.where(lower < 0.0, lower * below, lower), upper)
        return least, np.maximum(np.where(upper > 0.0, upper * above, upper), lower)

    def _envelope(self, state: RobotState, age: float) -> tuple[FloatArray, FloatArray]:
        """Joint torques [N m] ``(joints,)`` the motors allow at the speeds within reach in ``age`` [s]."""
        voltage = min(max(state.bus_voltage, 0.0), self._highest_voltage)
        velocity = state.joint_velocity
        if age > 0.0:
            velocity = velocity + age * self._band
        self._drive.set_bus_voltage(voltage)
        lower, upper = self._drive.limits(velocity)
        if age > 0.0:
            lower, upper = lower.min(axis=0), upper.max(axis=0)
        return lower * self._ratio, upper * self._ratio

    def servo(self, target: FloatArray, state: RobotState, age: float = 0.0) -> GuardedServo:
        """The command nearest to the robot's gains about ``target`` [rad] that keeps all limits at ``state``.

        ``age`` is that of the state when the command acts [s].
        """
        stiffness, damping = self._stiffness, self._damping
        least, greatest = self._torque_interval(state, age)
        wanted = pd_torque(stiffness, damping, target, state.joint_position, state.joint_velocity)
        allowed = np.minimum(np.maximum(wanted, least), greatest)
        same_sign = wanted * allowed > 0.0
        scale = np.where(same_sign, np.minimum(allowed / np.where(same_sign, wanted, 1.0), 1.0), 0.0)
        scale = np.where(allowed == wanted, 1.0, scale)
        reachable = np.minimum(np.maximum(target, self._lower), self._upper)
        scaled = stiffness * scale
        carried = scaled * (target - reachable) + (allowed - scale * wanted)
        return GuardedServo(reachable, scaled, damping * scale, carried)

    def damping(self, state: RobotState) -> GuardedServo:
        """A command that only damps, as hard as the motors allow: no target, stiffness or feedforward."""
        lower, upper = self._torque_interval(state, 0.0)
        wanted = -self._damping * state.joint_velocity
        allowed = np.minimum(np.maximum(wanted, np.minimum(lower, 0.0)), np.maximum(upper, 0.0))
        moving = wanted != 0.0
        scale = np.where(moving, allowed / np.where(moving, wanted, 1.0), 1.0)
        zeros = np.zeros_like(wanted)
        return GuardedServo(zeros, zeros, self._damping * scale, zeros)


def _share(value: FloatArray) -> FloatArray:
    return np.minimum(np.maximum(value, 0.0), 1.0)  # np.clip takes five times as long


def implied_torque(command: JointCommand, state: RobotState) -> FloatArray:
    """Joint torque [N m] ``(joints,)`` that a command of ``CommandWriter`` asks for at a state."""
    spring = command.stiffness * (command.target_position - state.joint_position)
    return spring - command.damping * state.joint_velocity + command.feedforward_torque
