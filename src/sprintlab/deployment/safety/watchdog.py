"""The robot's own watchdog, as ``sprintlab.deployment.interface`` demands it of every robot."""

from __future__ import annotations

import numpy as np

from sprintlab.deployment.interface import (
    WATCHDOG_TIMEOUT,
    FloatArray,
    JointCommand,
    JointMode,
    MessageError,
    RobotStatus,
    check_command,
)


class RobotWatchdog:
    """Decides on the robot which command the joints follow.

    Args:
        damping: applied while the watchdog has expired [N m s/rad] ``(12,)``.
        timeout: without an accepted command [s].

    Attributes:
        refused: commands dropped so far.
    """

    def __init__(self, damping: FloatArray, timeout: float = WATCHDOG_TIMEOUT) -> None:
        self._timeout = timeout - 1e-9
        self._zeros = np.zeros_like(damping)
        self._damping = np.asarray(damping, dtype=np.float64)
        self._command: JointCommand | None = None
        self._fed_at = 0.0
        self._expired = True
        self.refused = 0

    @property
    def status(self) -> RobotStatus:
        """``WATCHDOG_EXPIRED`` or nothing."""
        return RobotStatus.WATCHDOG_EXPIRED if self._expired else RobotStatus.READY

    @property
    def command_sequence(self) -> int:
        """Of the last accepted command; 0 before the first."""
        return self._command.sequence if self._command else 0

    def offer(self, command: JointCommand, time: float) -> bool:
        """Take a command that arrived at ``time`` [s] of the robot's clock; returns whether it was accepted.

        While expired, only ``OFF`` and ``DAMPING`` are accepted, whatever their sequence: a controller that
        was started anew counts from one again.
        """
        self._expire(time)
        if not self._acceptable(command):
            self.refused += 1
            return False
        self._command, self._fed_at, self._expired = command, time, False
        return True

    def active(self, time: float) -> JointCommand:
        """The command that the joints follow at ``time`` [s]: the last accepted one, or damping."""
        self._expire(time)
        if self._expired or self._command is None:
            return self._damp()
        return self._command

    def _expire(self, time: float) -> None:
        self._expired = self._expired or time - self._fed_at >= self._timeout

    def _acceptable(self, command: JointCommand) -> bool:
        try:
            check_command(command)
        except MessageError:
            return False
        if self._expired:
            return command.mode != JointMode.SERVO
        return command.sequence > self.command_sequence

    def _damp(self) -> JointCommand:
        return JointCommand(
            sequence=self.command_sequence,
            timestamp=0,
            mode=JointMode.DAMPING,
            target_position=self._zeros,
            stiffness=self._zeros,
            damping=self._damping,
            feedforward_torque=self._zeros,
        )
