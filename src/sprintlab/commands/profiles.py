"""Speed commands over time for evaluation: the paper's protocol and the sprint over a distance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from sprintlab.control.arrays import Array, as_array, clip
from sprintlab.core.checks import check_positive, check_range

SpeedValues = npt.NDArray[np.float64]

PACE_WINDOW = 1.0
"""How far a self-paced command may lead the robot [m/s]: the paper's neighbourhood."""

BRAKING_WINDOW = 4.0
"""How far a self-paced command may lag it [m/s]. Asked for no more than 1 m/s less than their speed, trained
policies brake at about 2 m/s^2, half of what the profile asks for, and are still running at its end."""


@dataclass(frozen=True, kw_only=True)
class _Rise:
    """Stand, then rise to the top speed."""

    top_speed: float  # greatest commanded speed [m/s]
    acceleration: float = 4.0  # acceleration of rise and fall [m/s^2]
    stand: float = 1.0  # duration of the stand before the rise [s]

    def __post_init__(self) -> None:
        check_positive("top_speed", self.top_speed, "m/s")
        check_positive("acceleration", self.acceleration, "m/s^2")
        check_range("stand", self.stand, 0.0, float("inf"), "s")

    def _rise(self, time: SpeedValues) -> SpeedValues:
        return np.clip(self.acceleration * (time - self.stand), 0.0, self.top_speed)


@dataclass(frozen=True, kw_only=True)
class SpeedProfile(_Rise):
    """Stand, rise to the top speed, hold it, fall to zero, stand."""

    hold: float = 10.0  # duration of the hold [s]
    rest: float = 2.0  # duration of the stand at the end [s]

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("hold", self.hold, 0.0, float("inf"), "s")
        check_range("rest", self.rest, 0.0, float("inf"), "s")

    @property
    def hold_interval(self) -> tuple[float, float]:
        """Start and end of the hold [s]."""
        start = self.stand + self.top_speed / self.acceleration
        return start, start + self.hold

    @property
    def _stop(self) -> float:
        """When the command is zero again [s]."""
        return self.hold_interval[1] + self.top_speed / self.acceleration

    @property
    def duration(self) -> float:
        """Length of the whole profile [s]."""
        return self._stop + self.rest

    def command(self, time: float | SpeedValues) -> SpeedValues:
        """Commanded forward speed [m/s] at ``time`` [s], of the same shape; zero before and after."""
        falling = self.acceleration * (self._stop - np.asarray(time))
        return np.minimum(self._rise(np.asarray(time)), np.maximum(falling, 0.0))


@dataclass(frozen=True, kw_only=True)
class SprintProfile(_Rise):
    """Stand, rise to the top speed, hold it until the distance is run, fall to zero.

    The profile does not know where the robot is: the caller says when the distance was reached.
    """

    def command(self, time: float | SpeedValues, finish_time: float | None = None) -> SpeedValues:
        """Commanded forward speed [m/s] at ``time`` [s], of the same shape.

        Args:
            time: since the start of the profile [s].
            finish_time: when the distance was reached [s], or None as long as it was not; the command
                falls from there, from whatever it had risen to.
        """
        moment = np.asarray(time)
        if finish_time is None:
            return self._rise(moment)
        falling = self._rise(np.asarray(finish_time)) - self.acceleration * (moment - finish_time)
        return np.where(moment < finish_time, self._rise(moment), np.maximum(falling, 0.0))

    def end_time(self, finish_time: float) -> float:
        """When the command is zero again [s]."""
        return finish_time + float(self._rise(np.asarray(finish_time))) / self.acceleration


def self_paced(
    command: Array | float,
    speed: Array | float,
    window: float = PACE_WINDOW,
    braking_window: Array | float = BRAKING_WINDOW,
) -> Array:
    """ACS at run time: ``command`` [m/s] kept near the measured ``speed`` [m/s], as in training.

    It never leads the robot by more than ``window`` nor lags it by more than ``braking_window``; shapes
    broadcast.
    """
    present = as_array(speed)
    return clip(as_array(command), present - braking_window, present + window)
