"""Gamepads through Linux's joystick devices (``/dev/input/js0``).

Events are eight bytes: time [ms] u32, value i16, kind u8 (1 button, 2 axis, 0x80 added for the first report),
number u8 (Linux, ``Documentation/input/joydev/joystick-api.rst``).
"""

from __future__ import annotations

import math
import os
import stat
import struct
from pathlib import Path

from sprintlab.core.errors import SprintlabError, printable

DEFAULT_DEVICE = Path("/dev/input/js0")

_EVENT = struct.Struct("=IhBB")
_BUTTON, _AXIS, _FIRST_REPORT = 1, 2, 0x80
_FULL = 32767.0
_SPEED_AXIS, _TURN_AXIS = 1, 3  # left stick up: forward; right stick left: turn left
_DEAD_ZONE = 0.08  # share of an axis around its middle that counts as zero
_NON_BLOCKING = getattr(os, "O_NONBLOCK", 0)  # other systems lack it, and have no such devices


class JoystickError(SprintlabError):
    """A joystick device is missing, may not be read, or is not a joystick."""


class Joystick:
    """Axes and buttons of a gamepad: a joystick device, or a named pipe that carries the same events."""

    def __init__(self, device: Path = DEFAULT_DEVICE) -> None:
        self.held: set[int] = set()  # numbers of the buttons that are down
        self._axes: dict[int, float] = {}
        try:
            self._descriptor: int | None = os.open(device, os.O_RDONLY | _NON_BLOCKING)
        except (OSError, ValueError) as error:  # ValueError: a zero byte in the name
            reason = getattr(error, "strerror", None) or str(error)
            raise JoystickError(f"cannot open the gamepad {printable(device)}: {reason}") from error
        kind = os.fstat(self._descriptor).st_mode
        if not (stat.S_ISCHR(kind) or stat.S_ISFIFO(kind)):
            self.close()
            raise JoystickError(f"{device} is no gamepad: name a joystick device such as {DEFAULT_DEVICE}")

    @property
    def connected(self) -> bool:
        """False once the pad was unplugged, its radio is gone, or it was closed."""
        return self._descriptor is not None

    def poll(self) -> tuple[int, ...]:
        """Numbers of the buttons pressed since the last call, oldest first.

        What is down or off centre when the device is opened is known but was not pressed. A pad that is
        gone is closed and presses nothing.
        """
        pressed: list[int] = []
        while (event := self._next_event()) is not None:
            value, kind, number = event
            if kind & ~_FIRST_REPORT == _AXIS:
                self._axes[number] = max(value / _FULL, -1.0)
            elif kind & ~_FIRST_REPORT == _BUTTON:
                (self.held.add if value else self.held.discard)(number)
            if kind == _BUTTON and value:
                pressed.append(number)
        return tuple(pressed)

    def sticks(self) -> tuple[float, float]:
        """Wanted shares of highest speed and turning rate, -1 to 1, forward and left positive."""
        return 0.0 - self.axis(_SPEED_AXIS, _DEAD_ZONE), 0.0 - self.axis(_TURN_AXIS, _DEAD_ZONE)

    def axis(self, number: int, dead_zone: float = 0.0) -> float:
        """Deflection from -1 to 1, zero inside the dead zone (0 to 0.9) and straight from its edge on."""
        value = self._axes.get(number, 0.0)
        beyond = max(abs(value) - dead_zone, 0.0) / (1.0 - dead_zone)
        return math.copysign(beyond, value)

    def close(self) -> None:
        """Let go of the device; a second call does nothing."""
        if self._descriptor is not None:
            os.close(self._descriptor)
        self._descriptor = None

    def _next_event(self) -> tuple[int, int, int] | None:
        """Value, kind and number; ``None`` when there is no more for now, or for good."""
        if self._descriptor is None:
            return None
        try:
            event = os.read(self._descriptor, _EVENT.size)
        except BlockingIOError:
            return None
        except OSError:
            event = b""
        if len(event) < _EVENT.size:
            self.close()
            return None
        _, value, kind, number = _EVENT.unpack(event)
        return value, kind, number


def joystick_name(device: Path) -> str:
    """What a gamepad calls itself in the kernel's list of input devices; else the device's own name."""
    try:
        listed = Path("/sys/class/input", os.path.basename(os.path.realpath(device)), "device", "name")
        return listed.read_text(encoding="utf-8").strip() or device.name
    except (OSError, ValueError):  # ValueError: no text, or a zero byte in the name
        return device.name
