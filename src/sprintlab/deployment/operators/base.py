"""What a command source is told, and what it says."""

from __future__ import annotations

import enum
from abc import ABC, abstractmethod
from typing import NamedTuple

from sprintlab.control import POLICY_RATE_HZ
from sprintlab.deployment.messages import FloatArray

PERIOD = 1.0 / POLICY_RATE_HZ
"""Between two readings of a source [s]."""


class Request(enum.IntEnum):
    """What an operator asks of the controller's state machine; of several at once the greatest counts."""

    NONE = 0
    PASSIVE = 1
    RUN = 2
    STAND = 3
    LIE_DOWN = 4
    STOP = 5


class OperatorCommand(NamedTuple):
    """What a command source wants."""

    velocity: FloatArray  # forward, sideways speed [m/s], yaw rate [rad/s] ``(3,)``
    request: Request = Request.NONE  # obeyed as soon as the robot is fit for it, while the source repeats it


class TrackPoint(NamedTuple):
    """Where the robot is, by its position fixes, from the line along which its run began."""

    distance: float  # along the line since the run began, carried on from the last fix [m]
    offset: float  # to the left of the line [m]
    speed: float  # along the line [m/s]


class SourceView(NamedTuple):
    """What the controller tells a command source at each policy step."""

    time: float  # controller's clock since its start [s]
    # name of the controller's mode (``passive``, ``stand-up``, ``stand``, ``run``, ``lie-down``, ``stop``)
    mode: str
    running_time: float = 0.0  # since the policy took over [s]; of ``run`` only
    heading: float = 0.0  # yaw relative to the heading at the start of ``run`` [rad]
    track: TrackPoint | None = None  # None without position fixes


class CommandSource(ABC):
    """Where the commanded velocity comes from; read at 50 Hz in the control thread, so it never blocks."""

    @abstractmethod
    def read(self, view: SourceView) -> OperatorCommand | None:
        """The source's present wish; None if it has nothing (counted as silence)."""

    def close(self) -> None:  # noqa: B027
        """Let go of devices, if it has any; a second call does nothing."""
