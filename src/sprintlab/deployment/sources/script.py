"""What a source without an operator asks of the state machine: stand up, run, stand, lie down."""

from __future__ import annotations

import numpy as np

from sprintlab.deployment.interface import FloatArray, OperatorCommand, Request, SourceView

_STANDING = 1.0  # [s] between standing and running


class ScriptedSource:
    """Stands up, runs until the wish ends, stops running, lies down, and is finished.

    Attributes:
        finished: whether the robot lies again.
    """

    def __init__(self) -> None:
        self.finished = False
        self._sequence = 0
        self._has_run = False
        self._stood_since: float | None = None
        self._over = False

    def wish(self, view: SourceView) -> FloatArray | None:
        """Velocity ``(3,)`` during the run; None once the run is over.

        Raises:
            LookupError: something that the wish depends on is not known now: the source falls silent.
        """
        raise NotImplementedError

    def read(self, view: SourceView) -> OperatorCommand | None:
        """The present wish; None, silence, where it depends on something that is not known."""
        velocity = np.zeros(3)
        if view.mode == "run":
            self._has_run = True
            try:
                wish = None if self._over else self.wish(view)
            except LookupError:
                return None
            self._over = wish is None
            velocity = velocity if wish is None else wish
        self._sequence += 1
        return OperatorCommand(
            sequence=self._sequence,
            timestamp=round(1e9 * view.time),
            velocity=velocity,
            request=self._request(view),
        )

    def close(self) -> None:
        """Nothing to let go of."""

    def _request(self, view: SourceView) -> Request:
        if view.mode == "stand" and self._stood_since is None:
            self._stood_since = view.time
        if view.mode in ("passive", "stop") and self._has_run:
            self.finished = True
            return Request.NONE
        if view.mode == "passive":
            return Request.STAND
        if view.mode == "stand" and not self._has_run:
            ready = self._stood_since is not None and view.time - self._stood_since >= _STANDING
            return Request.RUN if ready else Request.NONE
        if view.mode == "stand":
            return Request.LIE_DOWN
        return Request.STAND if self._over and view.mode == "run" else Request.NONE
