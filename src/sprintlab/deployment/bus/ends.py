"""What both ends of a bus do with messages, whatever carries the bytes."""

from __future__ import annotations

from abc import ABC, abstractmethod

import msgspec

from sprintlab.deployment.interface import (
    MOST_DAMAGED,
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

_MOST_FIXES = 4  # that one look takes: ten come a second


class BusEnd(ABC):
    """One end of a bus. What carries the bytes says how they come and go.

    Attributes:
        malformed: messages that ``decode`` refused.
    """

    malformed: int = 0

    @abstractmethod
    def _take(self, channel: str) -> bytes | None:
        """The next bytes of a channel that this end reads, in order of arrival; None if there are none."""

    @abstractmethod
    def _put(self, channel: str, content: bytes) -> None:
        """Send bytes over a channel that this end writes."""

    def _next(self, channel: str, kind: type[MessageType]) -> MessageType | None:
        for _ in range(MOST_DAMAGED):
            content = self._take(channel)
            if content is None:
                return None
            try:
                return self._decode(kind, content)
            except MessageError:
                self.malformed += 1
        return None

    def _encode(self, message: Message) -> bytes:
        """A message's bytes on this bus."""
        return encode(message)

    def _decode(self, kind: type[MessageType], content: bytes) -> MessageType:
        """The message of these bytes; raises ``MessageError`` where they are none."""
        return decode(kind, content)


class ControllerEnd(BusEnd):
    """The controller's end of a bus.

    Attributes:
        session: that the robot was told of: it takes commands of no other.
    """

    session: int = 0

    def receive(self) -> RobotState | None:
        """The next state in order of arrival; None until another arrives."""
        return self._next(STATE, RobotState)

    def receive_fix(self) -> PositionFix | None:
        """The newest position fix not yet read, if any."""
        newest = None
        for _ in range(_MOST_FIXES):
            fix = self._next(FIX, PositionFix)
            if fix is None:
                break
            newest = fix
        return newest

    def send(self, command: JointCommand) -> None:
        """Hand a command to the robot."""
        self._put(COMMAND, self._encode(command))


class RobotEnd(BusEnd):
    """The robot's end of a bus.

    Attributes:
        foreign: commands dropped because their session was not let in.
    """

    foreign: int = 0

    @property
    def ready(self) -> bool:
        """Whether a state that is published now reaches a controller, or waits for one."""
        return True

    def receive_command(self) -> JointCommand | None:
        """The next command in order of arrival of the controller that was let in; None if there is none."""
        for _ in range(MOST_DAMAGED):
            command = self._next(COMMAND, JointCommand)
            if command is None or self._admitted(command.session):
                return command
            self.foreign += 1
        return None

    def publish(self, state: RobotState) -> bool:
        """Send a state; the commands that this end dropped count as those that the robot did.

        Returns:
            Whether it was sent: a bus may carry fewer states than the robot has.
        """
        if self.foreign:
            foreign = state.foreign_commands + self.foreign
            state = msgspec.structs.replace(state, foreign_commands=foreign)
        self._put(STATE, self._encode(state))
        return True

    def _admitted(self, session: int) -> bool:
        """Whether a controller of this session was let in; a bus that lets nobody in knows none."""
        del session
        return True

    def publish_fix(self, fix: PositionFix) -> None:
        """Send a position fix."""
        self._put(FIX, self._encode(fix))
