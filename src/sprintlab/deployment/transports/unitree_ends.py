"""Both ends of a bus that speaks Unitree's messages, whatever carries their bytes.

Those messages have no numbers, no sessions and no answers, so that some of the controller's checks rest on
other facts here, and one on an assumption:

- a state's number and time come from the robot's clock (``tick``): duplicates, old states, gaps and a reboot
  show as on every bus;
- a command of another sender is heard on the topic itself, and the controller stops: the robot may obey it;
- motors that are not in servo mode are a robot that damps its joints by itself (all), or a failed drive;
- a robot that drops commands silently goes unnoticed. The last command counts as obeyed ``RESPONSE_TIME``
  after it was sent, as long as the topic has a reader; the envelope allows for states of that age.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Any

from msgspec.structs import replace

from sprintlab.deployment.messages import JointCommand, JointMode, MessageType, PositionFix, RobotState
from sprintlab.deployment.transports.ends import COMMAND, STATE, Carrier, ControllerEnd, RobotEnd
from sprintlab.deployment.transports.unitree_messages import (
    decode_command,
    decode_state,
    encode_command,
    encode_state,
)

PERIOD = 2_000_000
"""Between two messages of one end [ns]: 500 a second."""
RESPONSE_TIME = 4_000_000
"""From a command to the state that shows it, assumed [ns]: two periods of the robot."""
_SLACK = 500_000  # [ns] by which a message may come early
_MILLISECOND = 1_000_000
_TICKS = 1 << 32
_REMEMBERED = 64  # commands
_SUSPECTED = 40_000_000  # [ns]: longer than a controller goes without a usable state


class TickNumbers:
    """Numbers states by the robot's clock, which counts milliseconds in 32 bits and starts at zero.

    The first number is ``FIRST``: those of a robot that has begun anew lie below it, and above zero.
    """

    FIRST = 1 << 31

    def __init__(self) -> None:
        self._last: int | None = None
        self._number = self._time = 0

    def number(self, tick: int) -> tuple[int, int]:
        """Sequence and time [ns] of a state: as before for the same tick, lower for an older one."""
        if self._last is None:
            self._last, self._number, self._time = tick, self.FIRST, tick
        passed = (tick - self._last + _TICKS // 2) % _TICKS - _TICKS // 2
        periods = round(passed * _MILLISECOND / PERIOD)
        if passed <= 0:
            return self._number + min(periods, -(passed < 0)), max(self._time + passed, 0) * _MILLISECOND
        self._last, self._number, self._time = tick, self._number + max(periods, 1), self._time + passed
        return self._number, self._time * _MILLISECOND


class UnitreeControllerEnd(ControllerEnd):
    """The controller's end: sends ``LowCmd_``, hears ``LowState_`` and the ``LowCmd_`` of others."""

    def __init__(self, carrier: Carrier, session: int) -> None:
        super().__init__(carrier, session)
        self._numbers = TickNumbers()
        self._sent: deque[tuple[int, int]] = deque([(0, -RESPONSE_TIME)], _REMEMBERED)
        self._answered = 0
        self._last_mode: JointMode | None = None
        self._now = 0  # by the controller's clock [ns]
        self._overheard_at = -math.inf
        self._unanswered = False

    def receive(self) -> RobotState | None:
        """The next state in order of arrival; None until another arrives.

        Those after a command of another sender say that the robot obeys another session, for longer than a
        controller goes without a state that it judges: the first may be damaged, old or come twice.
        """
        while self.carrier.take(COMMAND) is not None:
            self._overheard_at = self._now
        state = super().receive()
        if state is None or self._now - self._overheard_at >= _SUSPECTED:
            return state
        return replace(state, session=self.session ^ 1)

    def receive_fix(self) -> PositionFix | None:
        """None: the messages have no position."""
        return None

    def send(self, command: JointCommand) -> None:
        """Hand a command to the robot: one a state, 500 a second without; another mode goes at once."""
        self._now = command.timestamp
        early = command.timestamp - self._sent[-1][1] < PERIOD - _SLACK
        if self._unanswered or not early or command.mode != self._last_mode:
            self._sent.append((command.sequence, command.timestamp))
            self._last_mode, self._unanswered = command.mode, False
            self.carrier.put(COMMAND, encode_command(command))

    def _decode(self, kind: type[MessageType], content: bytes) -> MessageType:
        tick, state = decode_state(content)
        self._unanswered = True
        sequence, timestamp = self._numbers.number(tick)
        answered = self._answer()
        session = self.session if answered else 0
        numbers = {"sequence": sequence, "timestamp": timestamp, "command_sequence": answered}
        found: Any = replace(state, session=session, **numbers)
        return found

    def _answer(self) -> int:
        """The newest command that the robot has had time to obey, by the times at which they were sent."""
        if self.carrier.is_heard:
            newest = self._sent[-1][1]
            due = (number for number, sent in self._sent if newest - sent >= RESPONSE_TIME)
            self._answered = max([self._answered, *due])
        return self._answered


class UnitreeRobotEnd(RobotEnd):
    """The robot's end: hears ``LowCmd_``, sends ``LowState_`` 500 times a second.

    Commands are numbered as they come, and all answer the newest state: the messages do not say.
    """

    def __init__(self, carrier: Carrier) -> None:
        super().__init__(carrier)
        self._received = 0
        self._last: RobotState | None = None

    def publish(self, state: RobotState) -> bool:
        """Send a state if one is due; whether it was sent."""
        last = self._last
        changed = last is None or last.status != state.status or state.timestamp < last.timestamp
        if last is not None and not changed and state.timestamp - last.timestamp < PERIOD - _SLACK:
            return False
        self._last = state
        self.carrier.put(STATE, encode_state(state))
        return True

    def publish_fix(self, fix: PositionFix) -> None:
        """Nothing: the messages have no position."""

    def _decode(self, kind: type[MessageType], content: bytes) -> MessageType:
        answered = 0 if self._last is None else self._last.sequence
        command: Any = decode_command(
            content, sequence=self._received + 1, session=self.carrier.author, state_sequence=answered
        )
        self._received += 1
        return command
