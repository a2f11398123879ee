"""How fast the commanded velocity may be, and change, whatever the operator says."""

from __future__ import annotations

import numpy as np

from sprintlab.commands.state import limit_yaw_rate
from sprintlab.core.checks import check_range
from sprintlab.deployment.messages import FloatArray

BRAKING = 4.0
"""Deceleration with which a brake brings the speeds to zero [m/s^2]."""
FRICTION = 0.7
"""Between feet and ground, at its lowest: ``|v w| <= mu g`` for every commanded turn."""
_BACKWARD, _SIDEWAYS, _YAW_RATE = 2.0, 0.0, 1.0  # greatest, beside the top speed [m/s, m/s, rad/s]
RATES = np.array([6.0, 6.0, 20.0])
"""Highest rates of change: forward and sideways speed [m/s^2], yaw rate [rad/s^2] ``(3,)``."""
OPERATOR_RATES = np.array([4.0, 4.0, 10.0])
"""The same for what a person or a file wishes for."""
_BRAKING_RATES = np.array([BRAKING, BRAKING, 20.0])


class VelocityLimiter:
    """Brings the commanded ``velocity`` (forward, sideways [m/s], yaw rate [rad/s]) towards a wish.

    ``top_speed`` [m/s] bounds it, ``rates`` ``(3,)`` [m/s^2, m/s^2, rad/s^2] its changes.
    """

    def __init__(self, top_speed: float, rates: FloatArray = RATES) -> None:
        check_range("top_speed", top_speed, 0.0, 50.0, "m/s")
        self.top_speed, self._rates = top_speed, rates
        self.velocity: FloatArray = np.zeros(3)
        self._lower = np.array([-_BACKWARD, -_SIDEWAYS, -_YAW_RATE])
        self._upper = np.array([top_speed, _SIDEWAYS, _YAW_RATE])

    @property
    def braking_time(self) -> float:
        """Time in which a brake from the top speed ends [s]."""
        return self.top_speed / BRAKING

    def reset(self) -> None:
        """Stand still."""
        self.velocity = np.zeros(3)

    def advance(self, wish: FloatArray, dt: float) -> FloatArray:
        """One step of ``dt`` [s] towards ``wish`` ``(3,)``; returns the new command."""
        return self._step(wish, self._rates * dt)

    def brake(self, dt: float, yaw_rate: float = 0.0) -> FloatArray:
        """One step of ``dt`` [s] towards standstill, keeping the course with ``yaw_rate`` [rad/s]."""
        return self._step(np.array([0.0, 0.0, yaw_rate]), _BRAKING_RATES * dt)

    def _step(self, wish: FloatArray, most: FloatArray) -> FloatArray:
        change = np.clip(wish, self._lower, self._upper) - self.velocity
        velocity = self.velocity + np.clip(change, -most, most)
        velocity[2] = float(limit_yaw_rate(velocity[2:3], velocity[:1], FRICTION)[0])
        self.velocity = velocity
        return velocity
