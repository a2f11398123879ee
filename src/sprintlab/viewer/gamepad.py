"""A gamepad that drives the live page: sticks for speed and turns, buttons for pushes and stops."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from sprintlab.core.joystick import Joystick, joystick_name

STOP = "stop"
ACTIONS = ("push-right", "push-left", STOP, "stand-up")
"""What the buttons A, B, X and Y do; a push goes to the side that it names."""


@dataclass(frozen=True, kw_only=True)
class PadReading:
    """What the pad says now.

    Sticks are wanted shares of highest speed and turning rate, -1 to 1, forward and left positive; ``None``
    while they rest, so that a slider moved by hand stays where it is.
    """

    sticks: tuple[float, float] | None = None
    actions: tuple[str, ...] = ()  # asked for since the last reading


class Gamepad:
    """A pad that may be unplugged.

    Raises:
        JoystickError: there is no such device now, or it may not be read.
    """

    def __init__(self, device: Path) -> None:
        self.name = joystick_name(device)
        self._joystick = Joystick(device)
        self._told = (0.0, 0.0)

    @property
    def connected(self) -> bool:
        """False while the pad is unplugged."""
        return self._joystick.connected

    def read(self) -> PadReading:
        """Sticks and buttons since the last reading; a pad that just went asks for a stop once."""
        if not self.connected:
            return PadReading()
        pressed = self._joystick.poll()
        if not self.connected:
            return PadReading(actions=(STOP,))
        actions = tuple(ACTIONS[button] for button in pressed if button < len(ACTIONS))
        sticks, before = self._joystick.sticks(), self._told
        self._told = sticks
        return PadReading(sticks=None if sticks == before else sticks, actions=actions)

    def close(self) -> None:
        """Let go of the device; a second call does nothing."""
        self._joystick.close()
