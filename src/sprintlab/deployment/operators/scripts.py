"""Sources that need no person: a sprint over a distance, and velocities over time from a file.

A file has the header ``time,forward`` and optionally ``yaw_rate``, then times that do not fall [s]; between
two lines the velocity goes straight, and where a time comes twice it steps.
"""

from __future__ import annotations

from abc import abstractmethod
from pathlib import Path

import numpy as np

from sprintlab.commands import SprintProfile, heading_command, self_paced
from sprintlab.core.archives import read_columns
from sprintlab.core.checks import check_positive
from sprintlab.core.errors import SprintlabError
from sprintlab.deployment.guard.velocity import OPERATOR_RATES, VelocityLimiter
from sprintlab.deployment.messages import FloatArray
from sprintlab.deployment.operators.base import (
    PERIOD,
    CommandSource,
    OperatorCommand,
    Request,
    SourceView,
)

_STANDING = 1.0  # [s] between standing and running
_COLUMNS = ("time", "forward", "yaw_rate")
_FASTEST = 50.0  # [m/s] or [rad/s]


class _ScriptedSource(CommandSource):
    """Stands up, runs until the wish ends, stops running, lies down."""

    _has_run = _over = False
    _stood_since: float | None = None

    @abstractmethod
    def wish(self, view: SourceView) -> FloatArray | None:
        """Velocity ``(3,)`` during the run; None once the run is over.

        Raises:
            LookupError: something that the wish depends on is not known now: the source falls silent.
        """

    def read(self, view: SourceView) -> OperatorCommand | None:
        """The present wish; None, silence, where it depends on something that is not known."""
        wish = None
        if view.mode == "run":
            self._has_run = True
            try:
                wish = None if self._over else self.wish(view)
            except LookupError:
                return None
            self._over = wish is None
        return OperatorCommand(np.zeros(3) if wish is None else wish, self._request(view))

    def _request(self, view: SourceView) -> Request:
        if view.mode == "run":
            return Request.STAND if self._over else Request.NONE
        if self._has_run:
            return Request.LIE_DOWN if view.mode == "stand" else Request.NONE
        if view.mode == "stand":
            self._stood_since = view.time if self._stood_since is None else self._stood_since
            return Request.RUN if view.time - self._stood_since >= _STANDING else Request.NONE
        return Request.STAND if view.mode == "passive" else Request.NONE


class SprintSource(_ScriptedSource):
    """Stand, rise to the top speed, hold it until the distance is run, brake, stand.

    Distance and speed come from the position fixes; between two of them the robot is taken to go on at its
    last speed, which costs 0.2 m/s of pace at 4 m/s^2 and 10 Hz. Without fixes a sprint has no end and no
    pace, so the source falls silent, as a source that is lost. With ``pace`` the command stays near the
    measured speed, as ``self_paced`` says (ACS at run time).
    """

    def __init__(self, top_speed: float, distance: float = 100.0, *, pace: bool = True) -> None:
        check_positive("sprint.distance", distance, "m")
        self.finish_time: float | None = None  # from the start of the run to the end of the distance [s]
        self._profile = SprintProfile(top_speed=top_speed, acceleration=float(OPERATOR_RATES[0]))
        self._distance, self._pace = distance, pace

    def wish(self, view: SourceView) -> FloatArray | None:
        """Velocity ``(3,)``; None a second after the brake's end; ``LookupError`` without a fix."""
        if view.track is None:
            raise LookupError("no position fix")
        time, track, profile = view.running_time, view.track, self._profile
        if self.finish_time is None and track.distance >= self._distance:
            self.finish_time = time
        finish = self.finish_time
        if finish is not None and time > profile.end_time(finish) + profile.stand:
            return None
        speed = float(profile.command(time, finish))
        if self._pace:
            speed = float(self_paced(speed, track.speed))
        return np.array([speed, 0.0, float(heading_command(view.heading, track.offset, speed))])


class ProfileSource(_ScriptedSource):
    """Follows a table of ``load_velocity_table`` from the start of the run; its steps become ramps."""

    def __init__(self, table: FloatArray) -> None:
        self._table, self._limiter = table, VelocityLimiter(_FASTEST, OPERATOR_RATES)

    def wish(self, view: SourceView) -> FloatArray | None:
        """Velocity ``(3,)``; None after the table's end."""
        known, forward, yaw_rate = self._table.T
        if view.running_time > known[-1]:
            return None
        speed, turn = (np.interp(view.running_time, known, column) for column in (forward, yaw_rate))
        return self._limiter.advance(np.array([speed, 0.0, turn]), PERIOD)


def load_velocity_table(path: Path) -> FloatArray:
    """Time from the start of the run [s], forward speed [m/s] and yaw rate [rad/s] ``(n, 3)`` of a file."""
    columns = read_columns(path, "profile file")
    if not {"time", "forward"} <= columns.keys() <= set(_COLUMNS):
        known = f"time, forward and perhaps yaw_rate, not {', '.join(columns)}"
        raise SprintlabError(f"{path} is not a profile: its columns must be {known}")
    table = np.stack([columns.get(name, 0.0 * columns["time"]) for name in _COLUMNS], axis=1)
    if not (np.diff(table[:, 0], prepend=0.0) >= 0.0).all():
        raise SprintlabError(f"{path} is not a profile: its times must rise from 0")
    if not (np.abs(table[:, 1:]) <= _FASTEST).all():
        raise SprintlabError(f"{path} is not a profile: a velocity is beyond {_FASTEST:g} m/s or rad/s")
    return table
