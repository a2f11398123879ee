"""Gamepads through Linux's joystick devices (``/dev/input/js0``).

Events are eight bytes: time [ms] u32, value i16, kind u8 (1 button, 2 axis, 0x80 added for the first report),
number u8 (Linux, ``Documentation/input/joydev/joystick-api.rst``).
"""

from __future__ import annotations

import contextlib
import math
import os
import stat
import struct
from dataclasses import dataclass
from pathlib import Path

from sprintlab.core.checks import check_range
from sprintlab.core.errors import SprintlabError, printable

DEFAULT_DEVICE = Path("/dev/input/js0")

_EVENT = struct.Struct("=IhBB")
_BUTTON, _AXIS, _FIRST_REPORT = 1, 2, 0x80
_FULL = 32767.0
_MOST_EVENTS = 1024  # in one look: a device that never ends cannot hold up its reader
_NON_BLOCKING = getattr(os, "O_NONBLOCK", 0)  # other systems lack it, and have no such devices


class JoystickError(SprintlabError):
    """A joystick device is missing, may not be read, or is not a joystick."""


class Joystick:
    """Axes and buttons of a gamepad.

    Attributes:
        device: where its events come from.
        held: numbers of the buttons that are down.

    Args:
        device: the joystick device, or a named pipe that carries the same events.

    Raises:
        JoystickError: there is no such device, it may not be read, or it is something else.
    """

    def __init__(self, device: Path = DEFAULT_DEVICE) -> None:
        self.device = device
        self.held: set[int] = set()
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
        """Take the events since the last look: the buttons pressed since then, oldest first.

        What is down or off centre when the device is opened is known but was not pressed. A pad that is
        gone is closed and presses nothing.
        """
        pressed: list[int] = []
        for _ in range(_MOST_EVENTS):
            event = self._next_event()
            if event is None:
                break
            value, kind, number = event
            self._take(value, kind & ~_FIRST_REPORT, number)
            if kind == _BUTTON and value:
                pressed.append(number)
        return tuple(pressed)

    def axis(self, number: int, dead_zone: float = 0.0) -> float:
        """Deflection from -1 to 1, zero inside the dead zone (0 to 0.9) and straight from its edge on."""
        value = self._axes.get(number, 0.0)
        beyond = max(abs(value) - dead_zone, 0.0) / (1.0 - dead_zone)
        return math.copysign(beyond, value)

    def close(self) -> None:
        """Let go of the device; a second call does nothing."""
        if self._descriptor is not None:
            with contextlib.suppress(OSError):
                os.close(self._descriptor)
        self._descriptor = None

    def _next_event(self) -> tuple[int, int, int] | None:
        """Value, kind and number; None when there is no more for now, or for good."""
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

    def _take(self, value: int, kind: int, number: int) -> None:
        if kind == _AXIS:
            self._axes[number] = max(value / _FULL, -1.0)
        elif kind == _BUTTON and value:
            self.held.add(number)
        elif kind == _BUTTON:
            self.held.discard(number)


@dataclass(frozen=True, kw_only=True)
class StickMapping:
    """Which axes steer; the defaults are an Xbox pad's.

    Attributes:
        speed_axis: up is forward (left stick).
        turn_axis: left turns left (right stick).
        dead_zone: share of an axis around its middle that counts as zero, 0 to 0.9.

    Raises:
        InvalidValueError: the dead zone is outside its range.
    """

    speed_axis: int = 1
    turn_axis: int = 3
    dead_zone: float = 0.08

    def __post_init__(self) -> None:
        check_range("gamepad.dead_zone", self.dead_zone, 0.0, 0.9)

    def sticks(self, joystick: Joystick) -> tuple[float, float]:
        """Wanted shares of highest speed and turning rate, -1 to 1, forward and left positive."""
        speed, turn = (joystick.axis(axis, self.dead_zone) for axis in (self.speed_axis, self.turn_axis))
        return 0.0 - speed, 0.0 - turn  # no negative zeros


def joystick_name(device: Path, listing: Path = Path("/sys/class/input")) -> str:
    """What a gamepad calls itself; the device's own name where the system does not say.

    Args:
        device: the joystick device.
        listing: the kernel's list of input devices.
    """
    try:
        place = Path(os.path.realpath(device))  # Path.resolve fails on a link that leads to itself
        name = (listing / place.name / "device" / "name").read_text(encoding="utf-8").strip()
    except (OSError, ValueError):  # ValueError: no text, or a zero byte in the name
        name = ""
    return name or device.name
