"""What sources share: how fast a wish may change, who asks for a stand or a run, and how they end."""

from __future__ import annotations

import numpy as np

from sprintlab.core.errors import SprintlabError
from sprintlab.deployment.interface import FloatArray, OperatorCommand, Request, SourceView

RATES = np.array([4.0, 4.0, 10.0])
"""Highest rates of change: of forward and sideways speed [m/s^2], of the yaw rate [rad/s^2] ``(3,)``."""
_BY_SEVERITY = (Request.NONE, Request.PASSIVE, Request.RUN, Request.STAND, Request.LIE_DOWN, Request.STOP)
_STANDING = 1.0  # [s] between standing and running


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


class _Source:
    """A source that gives a sign of life with every reading."""

    _sequence = 0

    def _say(self, velocity: FloatArray, request: Request) -> OperatorCommand:
        self._sequence += 1
        return OperatorCommand(sequence=self._sequence, velocity=velocity, request=request)

    def close(self) -> None:
        """Let go of devices; a second call does nothing."""


class OperatorSource(_Source):
    """A source that a person operates."""

    def __init__(self) -> None:
        self._slewed, self._request = Slewed(), Request.NONE

    def poll(self) -> FloatArray | None:
        """Look at the device: the wish ``(3,)``; None if the device is gone."""
        raise NotImplementedError

    def _ask(self, request: Request) -> None:
        """Note a request; of several in one look the most severe counts: nothing takes a stop back."""
        self._request = max(self._request, request, key=_BY_SEVERITY.index)

    def read(self, view: SourceView) -> OperatorCommand | None:
        """The present wish; None once the device is gone."""
        wish = self.poll()
        if wish is None:
            return None
        if view.mode != "run":
            self._slewed.reset()
            wish = np.zeros(3)
        request, self._request = self._request, Request.NONE
        return self._say(self._slewed.follow(wish, view.time), request)


class ScriptedSource(_Source):
    """Stands up, runs until the wish ends, stops running, lies down."""

    def __init__(self) -> None:
        self._has_run = self._over = False
        self._stood_since: float | None = None

    def wish(self, view: SourceView) -> FloatArray | None:
        """Velocity ``(3,)`` during the run; None once the run is over.

        Raises:
            LookupError: something that the wish depends on is not known now: the source falls silent.
        """
        raise NotImplementedError

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
        return self._say(np.zeros(3) if wish is None else wish, self._request(view))

    def _request(self, view: SourceView) -> Request:
        if view.mode == "run":
            return Request.STAND if self._over else Request.NONE
        if self._has_run:
            return Request.LIE_DOWN if view.mode == "stand" else Request.NONE
        if view.mode == "stand":
            self._stood_since = view.time if self._stood_since is None else self._stood_since
            return Request.RUN if view.time - self._stood_since >= _STANDING else Request.NONE
        return Request.STAND if view.mode == "passive" else Request.NONE
