"""How fast a source's wish may change, whatever the stick or the file does."""

from __future__ import annotations

import numpy as np

from sprintlab.core.errors import SprintlabError
from sprintlab.deployment.interface import FloatArray

RATES = np.array([4.0, 4.0, 10.0])
"""Highest rates of change: of forward and sideways speed [m/s^2], of the yaw rate [rad/s^2] ``(3,)``."""


class SourceError(SprintlabError):
    """A command source cannot be opened, or its file makes no sense."""


class Slewed:
    """Forward, sideways speed [m/s] and yaw rate [rad/s] ``(3,)`` that follow others within ``RATES``."""

    def __init__(self) -> None:
        self._velocity: FloatArray = np.zeros(3)
        self._time: float | None = None

    def reset(self) -> None:
        """Wish to stand."""
        self._velocity = np.zeros(3)

    def follow(self, wish: FloatArray, time: float) -> FloatArray:
        """The velocity at ``time`` [s]."""
        most = RATES * max(time - (time if self._time is None else self._time), 0.0)
        self._time = time
        self._velocity = self._velocity + np.clip(wish - self._velocity, -most, most)
        return self._velocity
