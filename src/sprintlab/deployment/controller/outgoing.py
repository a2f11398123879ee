"""The joint commands that leave a controller: guarded, numbered, remembered."""

from __future__ import annotations

import numpy as np

from sprintlab.deployment.interface import (
    FloatArray,
    JointCommand,
    JointMode,
    RobotState,
)
from sprintlab.deployment.safety import CommandGuard, LinkAge, implied_torque
from sprintlab.robots import RobotDescription

_LARGEST_SAG = 0.4  # rad between targets and positions that a motion takes over


class CommandWriter:
    """Writes the commands for one robot. ``state`` is the last one; ``now`` is the monotonic clock [ns].

    Args:
        robot: to which they go.
        session: number that they carry.

    Attributes:
        guard: the gate that every command passes.
    """

    def __init__(self, robot: RobotDescription, session: int) -> None:
        self.guard = CommandGuard(robot)
        self._robot, self._session = robot, session
        self._link = LinkAge()
        self._zeros = np.zeros(len(robot.joint_names))
        self._sequence = 0
        self._last: JointCommand | None = None

    def has_sent(self, state: RobotState) -> bool:
        """Whether the command that a robot obeys is one of these, which are numbered 1, 2, 3, …"""
        return state.session == self._session and 1 <= state.command_sequence <= self._sequence

    def off(self, now: int, state: RobotState | None) -> JointCommand:
        """No torque."""
        return self._write(now, state, JointMode.OFF, self._zeros, self._zeros, self._zeros, self._zeros)

    def servo(self, now: int, state: RobotState, targets: FloatArray) -> JointCommand | None:
        """The robot's gains about ``targets`` [rad] ``(joints,)``, within every limit; None without any."""
        age = self._link.both_ways(state.command_sequence, now)
        servo = self.guard.servo(targets, self._robot.stiffness, self._robot.damping, state, age)
        if servo is None:
            return None
        return self._write(now, state, JointMode.SERVO, *servo)

    def damping(self, now: int, state: RobotState, *, stale: bool) -> JointCommand:
        """Damping within the envelope; the full gains where the joints' speeds are no longer known."""
        if stale:
            damping = np.array(self._robot.damping)
            return self._write(now, state, JointMode.DAMPING, self._zeros, self._zeros, damping, self._zeros)
        return self._write(now, state, JointMode.DAMPING, *self.guard.damping(self._robot.damping, state))

    def bumpless_start(self, state: RobotState) -> FloatArray:
        """Targets [rad] that ask for the torque of the last command: a motion from there begins smoothly."""
        if self._last is None:
            return state.joint_position.copy()
        torque = implied_torque(self._last, state)
        offset = np.clip(torque / self._robot.stiffness, -_LARGEST_SAG, _LARGEST_SAG)
        lower, upper = self._robot.position_limits.T
        return np.clip(state.joint_position + offset, lower, upper)

    def _write(
        self,
        now: int,
        state: RobotState | None,
        mode: JointMode,
        target: FloatArray,
        stiffness: FloatArray,
        damping: FloatArray,
        feedforward: FloatArray,
    ) -> JointCommand:
        self._sequence += 1
        self._link.sent(self._sequence, now)
        self._last = JointCommand(
            sequence=self._sequence,
            timestamp=now,
            mode=mode,
            target_position=target,
            stiffness=stiffness,
            damping=damping,
            feedforward_torque=feedforward,
            state_sequence=state.sequence if state else 0,
            session=self._session,
        )
        return self._last
