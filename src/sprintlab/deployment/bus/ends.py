"""What both ends of a bus do with messages, whatever carries the bytes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter

from sprintlab.deployment.interface import (
    JointCommand,
    Message,
    MessageError,
    MessageType,
    PositionFix,
    RobotState,
    decode,
    encode,
)

STATE, COMMAND, FIX = "state", "command", "fix"
"""The channels of a robot: its controller writes ``COMMAND``, the robot the others."""


class BusEnd(ABC):
    """One end of a bus. Sending and receiving take no longer than a few microseconds.

    Attributes:
        refused: messages that could not be decoded, counted by the reason.
    """

    def __init__(self) -> None:
        self.refused: Counter[str] = Counter()

    @abstractmethod
    def _take(self, channel: str) -> bytes | None:
        """The next bytes of a channel that this end reads, in order of arrival; None if there are none."""

    @abstractmethod
    def _put(self, channel: str, content: bytes) -> None:
        """Send bytes over a channel that this end writes."""

    @property
    @abstractmethod
    def peer_left(self) -> bool:
        """Whether the other end was there and is gone."""

    @abstractmethod
    def close(self) -> None:
        """Let go of the bus; a second call does nothing."""

    def _next(self, channel: str, kind: type[MessageType]) -> MessageType | None:
        while (content := self._take(channel)) is not None:
            try:
                return self._decode(kind, content)
            except MessageError as error:
                self.refused[str(error)] += 1
        return None

    def _encode(self, message: Message) -> bytes:
        """A message's bytes on this bus."""
        return encode(message)

    def _decode(self, kind: type[MessageType], content: bytes) -> MessageType:
        """The message of these bytes; raises ``MessageError`` where they hold none."""
        return decode(kind, content)


class ControllerEnd(BusEnd):
    """The controller's end of a bus.

    Args:
        session: number of the controller that holds this end.
    """

    def __init__(self, session: int) -> None:
        super().__init__()
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
        self._put(COMMAND, self._encode(command))


class RobotEnd(BusEnd):
    """The robot's end of a bus."""

    ready: bool = True
    """Whether a state that is published now reaches a controller, or waits for one."""

    def receive_command(self) -> JointCommand | None:
        """The next command in order of arrival; None until another arrives."""
        return self._next(COMMAND, JointCommand)

    def publish(self, state: RobotState) -> bool:
        """Send a state; whether it was sent, since a bus may carry fewer states than the robot has."""
        self._put(STATE, self._encode(state))
        return True

    def publish_fix(self, fix: PositionFix) -> None:
        """Send a position fix."""
        self._put(FIX, self._encode(fix))
