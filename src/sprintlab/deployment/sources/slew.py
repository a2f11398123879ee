"""How fast a source's wish may change, whatever the stick or the file does."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sprintlab.core.checks import check_positive
from sprintlab.core.errors import SprintlabError
from sprintlab.deployment.interface import FloatArray


class SourceError(SprintlabError):
    """A command source cannot be opened, or its file makes no sense."""


@dataclass(frozen=True, kw_only=True)
class SlewLimits:
    """Highest rates of change of a wish.

    Attributes:
        acceleration: change of forward and sideways speed, away from zero [m/s^2].
        braking: change of the same speeds, towards zero [m/s^2].
        yaw_acceleration: change of the yaw rate [rad/s^2].

    Raises:
        InvalidValueError: a rate is not positive.
    """

    acceleration: float = 4.0
    braking: float = 4.0
    yaw_acceleration: float = 10.0

    def __post_init__(self) -> None:
        check_positive("slew.acceleration", self.acceleration, "m/s^2")
        check_positive("slew.braking", self.braking, "m/s^2")
        check_positive("slew.yaw_acceleration", self.yaw_acceleration, "rad/s^2")


class Slewed:
    """A wish that follows another one within ``SlewLimits``.

    Attributes:
        velocity: the present wish: forward, sideways speed [m/s], yaw rate [rad/s] ``(3,)``.
    """

    def __init__(self, limits: SlewLimits) -> None:
        self.velocity: FloatArray = np.zeros(3)
        self._limits = limits
        self._time: float | None = None

    def reset(self) -> None:
        """Wish to stand."""
        self.velocity = np.zeros(3)

    def follow(self, wish: FloatArray, time: float) -> FloatArray:
        """The wish at ``time`` [s]; a copy."""
        elapsed = 0.0 if self._time is None else max(time - self._time, 0.0)
        self._time = time
        limits, present = self._limits, self.velocity
        slowing = np.abs(wish[:2]) < np.abs(present[:2])
        linear = np.where(slowing, limits.braking, limits.acceleration)
        most = elapsed * np.append(linear, limits.yaw_acceleration)
        self.velocity = present + np.clip(wish - present, -most, most)
        return self.velocity.copy()
