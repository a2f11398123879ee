"""Steering with a gamepad through Linux's joystick devices (``/dev/input/js0``).

Events are eight bytes: time [ms] u32, value i16, kind u8 (1 button, 2 axis, 0x80 added for the first report),
number u8 (Linux, ``Documentation/input/joydev/joystick-api.rst``).
"""

from __future__ import annotations

import contextlib
import os
import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sprintlab.core.checks import check_positive, check_range
from sprintlab.deployment.interface import FloatArray, Request
from sprintlab.deployment.sources.operator import OperatorSource
from sprintlab.deployment.sources.slew import SlewLimits, SourceError

_EVENT = struct.Struct("=IhBB")
_BUTTON, _AXIS, _FIRST_REPORT = 1, 2, 0x80
_FULL = 32767.0


@dataclass(frozen=True, kw_only=True)
class GamepadMapping:
    """Which axis and which button does what; the defaults are an Xbox pad's.

    Attributes:
        speed_axis: up is forward (left stick).
        turn_axis: left turns left (right stick).
        dead_zone: share of an axis around its middle that counts as zero, 0 to 0.9.
        alive_button: no speed unless it is held down (right shoulder).
        buttons: number of a button to the request it makes: A stand, Start run, B lie down, X stop, Back
            passive.

    Raises:
        InvalidValueError: the dead zone is outside its range.
    """

    speed_axis: int = 1
    turn_axis: int = 3
    dead_zone: float = 0.08
    alive_button: int = 5
    buttons: tuple[tuple[int, Request], ...] = (
        (0, Request.STAND),
        (7, Request.RUN),
        (1, Request.LIE_DOWN),
        (2, Request.STOP),
        (6, Request.PASSIVE),
    )

    def __post_init__(self) -> None:
        check_range("gamepad.dead_zone", self.dead_zone, 0.0, 0.9)


class GamepadSource(OperatorSource):
    """A gamepad. When it is unplugged or its radio is gone, the source falls silent.

    Args:
        device: the joystick device.
        top_speed: with the stick fully forward [m/s]; backwards a fifth of it.
        limits: slew limits.
        mapping: axes and buttons.

    Raises:
        SourceError: there is no such device, or it may not be read.
        InvalidValueError: the speed is not positive.
    """

    def __init__(
        self,
        device: Path = Path("/dev/input/js0"),
        top_speed: float = 6.0,
        limits: SlewLimits | None = None,
        mapping: GamepadMapping | None = None,
    ) -> None:
        check_positive("gamepad.top_speed", top_speed, "m/s")
        super().__init__(limits)
        self._mapping, self._top_speed = mapping or GamepadMapping(), top_speed
        self._requests = dict(self._mapping.buttons)
        self._axes: dict[int, float] = {}
        self._alive = False
        try:
            self._descriptor: int | None = os.open(device, os.O_RDONLY | os.O_NONBLOCK)
        except OSError as error:
            raise SourceError(f"cannot open the gamepad {device}: {error.strerror or error}") from error

    def poll(self) -> FloatArray | None:
        """Take the events since the last look; None once the pad is gone."""
        while self._descriptor is not None:
            try:
                event = os.read(self._descriptor, _EVENT.size)
            except BlockingIOError:
                break
            except OSError:
                event = b""
            if len(event) < _EVENT.size:
                self.close()
                return None
            self._take(*_EVENT.unpack(event)[1:])
        return None if self._descriptor is None else self._wish()

    def close(self) -> None:
        """Let go of the device; a second call does nothing."""
        if self._descriptor is not None:
            with contextlib.suppress(OSError):
                os.close(self._descriptor)
        self._descriptor = None

    def _take(self, value: int, kind: int, number: int) -> None:
        if kind & ~_FIRST_REPORT == _AXIS:
            self._axes[number] = max(value / _FULL, -1.0)
        elif number == self._mapping.alive_button:
            self._alive = value != 0
        elif kind == _BUTTON and value and number in self._requests:
            self._request = self._requests[number]

    def _wish(self) -> FloatArray:
        if not self._alive:
            return np.zeros(3)
        push = -self._axis(self._mapping.speed_axis)
        speed = self._top_speed * (push if push > 0.0 else 0.2 * push)
        return np.array([speed, 0.0, -self._axis(self._mapping.turn_axis)])

    def _axis(self, number: int) -> float:
        """Deflection from -1 to 1, zero inside the dead zone and straight from its edge on."""
        value, zone = self._axes.get(number, 0.0), self._mapping.dead_zone
        beyond = max(abs(value) - zone, 0.0) / (1.0 - zone)
        return float(np.copysign(beyond, value))
