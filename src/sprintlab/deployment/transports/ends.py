"""What both ends of a bus do with messages, whatever carries the bytes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter

from sprintlab.deployment.messages import (
    JointCommand,
    MessageError,
    MessageType,
    PositionFix,
    RobotState,
    decode,
    encode,
)

STATE, COMMAND, FIX = "state", "command", "fix"
"""The channels of a robot: its controller writes ``COMMAND``, the robot the others."""


class Carrier(ABC):
    """Carries bytes from and to the other end, within a few microseconds."""

    author: int = 1
    """Number of the program that sent what was taken last, where the carrier tells programs apart."""

    @abstractmethod
    def take(self, channel: str) -> bytes | None:
        """The next bytes of a channel that this end reads, in order of arrival; None if there are none."""

    @abstractmethod
    def put(self, channel: str, content: bytes) -> None:
        """Send bytes over a channel that this end writes."""

    @property
    @abstractmethod
    def peer_left(self) -> bool:
        """Whether the other end was there and is gone."""

    @property
    def is_heard(self) -> bool:
        """Whether somebody reads what this end writes."""
        return True

    @property
    def ready(self) -> bool:
        """Whether a message that is sent now is read, or waits to be read."""
        return True

    @abstractmethod
    def close(self) -> None:
        """Let go of the bus; a second call does nothing."""


class _End:
    """One end of a bus; ``refused`` counts messages that could not be decoded by the reason."""

    def __init__(self, carrier: Carrier) -> None:
        self.carrier, self.close = carrier, carrier.close
        self.refused: Counter[str] = Counter()

    @property
    def peer_left(self) -> bool:
        """Whether the other end was there and is gone."""
        return self.carrier.peer_left

    def _next(self, channel: str, kind: type[MessageType]) -> MessageType | None:
        while (content := self.carrier.take(channel)) is not None:
            try:
                return self._decode(kind, content)
            except MessageError as error:
                self.refused[str(error)] += 1
        return None

    def _decode(self, kind: type[MessageType], content: bytes) -> MessageType:
        return decode(kind, content)


class ControllerEnd(_End):
    """The controller's end of a bus; ``session`` is the number of the controller that holds it."""

    def __init__(self, carrier: Carrier, session: int) -> None:
        super().__init__(carrier)
        self.session = session

    def receive(self) -> RobotState | None:
        """The next state in order of arrival; None until another arrives. Duplicates are passed on."""
        return self._next(STATE, RobotState)

    def receive_fix(self) -> PositionFix | None:
        """The newest position fix not yet read, if any."""
        newest = None
        while (fix := self._next(FIX, PositionFix)) is not None:
            newest = fix
        return newest

    def send(self, command: JointCommand) -> None:
        """Hand a command to the robot."""
        self.carrier.put(COMMAND, encode(command))


class RobotEnd(_End):
    """The robot's end of a bus."""

    def receive_command(self) -> JointCommand | None:
        """The next command in order of arrival; None until another arrives."""
        return self._next(COMMAND, JointCommand)

    def publish(self, state: RobotState) -> bool:
        """Send a state; whether it was sent, since a bus may carry fewer states than the robot has."""
        self.carrier.put(STATE, encode(state))
        return True

    def publish_fix(self, fix: PositionFix) -> None:
        """Send a position fix."""
        self.carrier.put(FIX, encode(fix))
