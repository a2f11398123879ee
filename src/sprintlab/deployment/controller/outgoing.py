"""The joint commands that leave a controller: guarded, numbered, remembered."""

from __future__ import annotations

import numpy as np

from sprintlab.deployment.guard import CommandGuard, GuardedServo, implied_torque
from sprintlab.deployment.messages import FloatArray, JointCommand, JointMode, RobotState
from sprintlab.robots import RobotDescription

_LARGEST_SAG = 0.4  # rad between targets and positions that a motion takes over
_REMEMBERED = 1024  # commands: a second of them, ten times what a robot may leave unanswered
_REPORTING = 0.001  # [s] for which a command has acted when a state reports it


class CommandWriter:
    """Writes the commands for one robot. ``state`` is the last one; ``now`` is the monotonic clock [ns]."""

    answers = 0
    """Number of the newest state that has come, which the commands name."""

    def __init__(self, robot: RobotDescription, session: int) -> None:
        self.guard = CommandGuard(robot)
        self._robot, self._session = robot, session
        zeros = np.zeros(len(robot.joint_names))
        self._off = GuardedServo(zeros, zeros, zeros, zeros)
        self._full_damping = self._off._replace(damping=np.array(robot.damping))
        self._sequence, self._sent_at = 0, np.zeros(_REMEMBERED, np.int64)
        self._last: JointCommand | None = None

    def has_sent(self, state: RobotState) -> bool:
        """Whether the command that a robot obeys is one of these, which are numbered 1, 2, 3, …"""
        return state.session == self._session and 1 <= state.command_sequence <= self._sequence

    def age(self, state: RobotState, now: int) -> float:
        """How old a state is when a command that leaves now acts [s]; 0 where that is not known.

        Every state names the last command that the robot accepted. What has passed since that command was
        sent is the way there, a millisecond in which it acted, and the way back: both ways together. Lost
        messages count, since the robot goes on with older ones. No clocks are compared.
        """
        if not self._sequence - _REMEMBERED < state.command_sequence <= self._sequence:
            return 0.0
        sent_at = int(self._sent_at[state.command_sequence % _REMEMBERED]) or now
        return max((now - sent_at) * 1e-9 - _REPORTING, 0.0)

    def off(self, now: int) -> JointCommand:
        """No torque."""
        return self._write(now, JointMode.OFF, self._off)

    def servo(self, now: int, state: RobotState, targets: FloatArray) -> JointCommand:
        """The robot's gains about ``targets`` [rad] ``(joints,)``, within every limit."""
        servo = self.guard.servo(targets, state, self.age(state, now))
        return self._write(now, JointMode.SERVO, servo)

    def damping(self, now: int, state: RobotState, *, stale: bool) -> JointCommand:
        """Damping within the envelope; the full gains where the joints' speeds are no longer known."""
        servo = self._full_damping if stale else self.guard.damping(state)
        return self._write(now, JointMode.DAMPING, servo)

    def bumpless_start(self, state: RobotState) -> FloatArray:
        """Targets [rad] that ask for the torque of the last command: a motion from there begins smoothly."""
        torque = 0.0 if self._last is None else implied_torque(self._last, state)
        offset = np.clip(torque / self._robot.stiffness, -_LARGEST_SAG, _LARGEST_SAG)
        lower, upper = self._robot.position_limits.T
        return np.clip(state.joint_position + offset, lower, upper)

    def _write(self, now: int, mode: JointMode, servo: GuardedServo) -> JointCommand:
        self._sequence += 1
        self._sent_at[self._sequence % _REMEMBERED] = now
        self._last = JointCommand(
            sequence=self._sequence,
            timestamp=now,
            mode=mode,
            **servo._asdict(),
            state_sequence=self.answers,
            session=self._session,
        )
        return self._last
