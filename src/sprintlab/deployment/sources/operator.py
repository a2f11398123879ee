"""What gamepad and keyboard share: a wish, a request that is made once, and a life sign."""

from __future__ import annotations

import numpy as np

from sprintlab.deployment.interface import FloatArray, OperatorCommand, Request, SourceView
from sprintlab.deployment.sources.slew import Slewed

_BY_SEVERITY = (Request.NONE, Request.PASSIVE, Request.RUN, Request.STAND, Request.LIE_DOWN, Request.STOP)


class OperatorSource:
    """A source that a person operates."""

    def __init__(self) -> None:
        self._slewed, self._sequence, self._request = Slewed(), 0, Request.NONE

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
        self._sequence += 1
        request, self._request = self._request, Request.NONE
        return OperatorCommand(
            sequence=self._sequence,
            timestamp=round(1e9 * view.time),
            velocity=self._slewed.follow(wish, view.time),
            request=request,
        )
