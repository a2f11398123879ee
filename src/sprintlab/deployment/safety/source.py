"""Whether the command source lives, and how fast its wishes may change."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sprintlab.commands.state import limit_yaw_rate
from sprintlab.core.checks import check_positive, check_range
from sprintlab.deployment.interface import FloatArray, OperatorCommand, Request
from sprintlab.deployment.safety.faults import Fault


class SourceMonitor:
    """Takes what a command source says; silence is counted from its last sign of life.

    Attributes:
        velocity: last accepted wish ``(3,)``.
    """

    def __init__(self, timeout: float) -> None:
        self._timeout = timeout
        self.velocity: FloatArray = np.zeros(3)
        self._sequence: int | None = None
        self._heard_at = -np.inf

    def accept(self, command: OperatorCommand | None, time: float) -> tuple[Request, list[Fault]]:
        """Take one reading of the source: what the operator asks for, and faults."""
        if command is None or command.sequence == self._sequence:
            return Request.NONE, []
        old = self._sequence is not None and command.sequence < self._sequence
        if old or command.velocity.shape != (3,) or not np.isfinite(command.velocity).all():
            return Request.NONE, [Fault.SOURCE_INVALID]
        self._sequence, self._heard_at, self.velocity = command.sequence, time, command.velocity
        return command.request, []

    def lost(self, time: float) -> bool:
        """Whether the source has been silent for too long; also when it has never spoken."""
        return time - self._heard_at >= self._timeout - 1e-9


@dataclass(frozen=True, kw_only=True)
class VelocityLimits:
    """Bounds of the commanded velocity and of its change, whatever the source says.

    Raises:
        InvalidValueError: a field is not finite, negative, or a rate is zero.
    """

    forward: float = 12.0  # [m/s]
    backward: float = 2.0  # [m/s]
    sideways: float = 0.0  # [m/s]
    yaw_rate: float = 1.0  # [rad/s]; also ``|v w| <= mu g`` with ``friction``
    acceleration: float = 6.0  # [m/s^2] rate of change of the speeds
    yaw_acceleration: float = 20.0  # [rad/s^2] rate of change of the yaw rate
    braking: float = 4.0  # [m/s^2] rate at which a brake brings the speeds to zero
    friction: float = 0.7  # coefficient between feet and ground, at its lowest

    def __post_init__(self) -> None:
        for field in ("forward", "backward", "sideways", "yaw_rate"):
            check_range(f"velocity_limits.{field}", getattr(self, field), 0.0, 50.0)
        for field in ("acceleration", "yaw_acceleration", "braking", "friction"):
            check_positive(f"velocity_limits.{field}", getattr(self, field))


class VelocityLimiter:
    """Brings the commanded velocity towards what is wished for, within ``VelocityLimits``.

    Attributes:
        velocity: present command ``(3,)``.
    """

    def __init__(self, limits: VelocityLimits) -> None:
        self.limits = limits
        self.velocity: FloatArray = np.zeros(3)
        self._lower = np.array([-limits.backward, -limits.sideways, -limits.yaw_rate])
        self._upper = np.array([limits.forward, limits.sideways, limits.yaw_rate])
        self._rates = np.array([limits.acceleration, limits.acceleration, limits.yaw_acceleration])
        self._braking = np.array([limits.braking, limits.braking, limits.yaw_acceleration])

    def reset(self) -> None:
        """Stand still."""
        self.velocity = np.zeros(3)

    def advance(self, wish: FloatArray, dt: float) -> FloatArray:
        """One step of ``dt`` [s] towards ``wish`` ``(3,)``; returns the new command."""
        return self._step(wish, self._rates * dt)

    def brake(self, dt: float, yaw_rate: float = 0.0) -> FloatArray:
        """One step of ``dt`` [s] towards standstill, keeping the course with ``yaw_rate`` [rad/s]."""
        return self._step(np.array([0.0, 0.0, yaw_rate]), self._braking * dt)

    def _step(self, wish: FloatArray, most: FloatArray) -> FloatArray:
        change = np.clip(wish, self._lower, self._upper) - self.velocity
        velocity = self.velocity + np.clip(change, -most, most)
        velocity[2] = float(limit_yaw_rate(velocity[2:3], velocity[:1], self.limits.friction)[0])
        self.velocity = velocity
        return velocity.copy()
