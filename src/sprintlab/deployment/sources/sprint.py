"""A sprint over a distance, its command raw or kept near the robot's own speed (ACS at run time)."""

from __future__ import annotations

import math

import numpy as np

from sprintlab.commands import SprintProfile, heading_angle, heading_command, self_paced
from sprintlab.core.checks import check_positive
from sprintlab.deployment.interface import FloatArray, SourceView
from sprintlab.deployment.sources.base import RATES, ScriptedSource


class SprintSource(ScriptedSource):
    """Stand, rise to the top speed, hold it until the distance is run, brake, stand.

    Distance and speed come from the position fixes; between two of them the robot is taken to go on at its
    last speed, which costs 0.2 m/s of pace at 4 m/s^2 and 10 Hz. Without fixes a sprint has no end and no
    pace, so the source falls silent, as a source that is lost.

    Args:
        top_speed: [m/s].
        distance: [m].
        pace: keep the command near the measured speed, as ``self_paced`` does.

    Attributes:
        finish_time: time from the start of the run to the end of the distance [s].

    Raises:
        InvalidValueError: a number is not positive.
    """

    def __init__(self, top_speed: float, distance: float = 100.0, *, pace: bool = True) -> None:
        super().__init__()
        check_positive("sprint.distance", distance, "m")
        self.finish_time: float | None = None
        self._profile = SprintProfile(top_speed=top_speed, acceleration=float(RATES[0]))
        self._distance, self._pace = distance, pace
        self._origin: FloatArray | None = None
        self._direction = np.zeros(2)
        self._fix_sequence: int | None = None
        self._fix_time = 0.0

    def wish(self, view: SourceView) -> FloatArray | None:
        """Velocity ``(3,)``; None a second after the brake's end; ``LookupError`` without a fix."""
        if view.fix is None or view.forward_speed is None or view.running_time is None:
            raise LookupError("no position fix")
        time = view.running_time
        if self.finish_time is None and self._way(view) >= self._distance:
            self.finish_time = time
        finish, profile = self.finish_time, self._profile
        if finish is not None and time > profile.end_time(finish) + profile.stand:
            return None
        speed = float(profile.command(time, finish))
        if self._pace:
            speed = float(self_paced(speed, view.forward_speed))
        return np.array([speed, 0.0, float(heading_command(view.heading, view.lateral_offset, speed))])

    def _way(self, view: SourceView) -> float:
        """Way along the course since the run began, carried on from the last fix [m]."""
        assert view.fix is not None and view.forward_speed is not None
        if self._origin is None:
            self._origin = view.fix.position
            course = float(heading_angle(view.state.quaternion)) - view.heading
            self._direction = np.array([math.cos(course), math.sin(course)])
        if view.fix.sequence != self._fix_sequence:
            self._fix_sequence, self._fix_time = view.fix.sequence, view.time
        way = float((view.fix.position - self._origin)[:2] @ self._direction)
        return way + view.forward_speed * (view.time - self._fix_time)
