"""Keyboard and gamepad: what a person operates."""

from __future__ import annotations

import contextlib
import os
import re
import select
import sys
import termios
import tty
from abc import abstractmethod
from pathlib import Path

import numpy as np

from sprintlab.core.checks import check_positive
from sprintlab.core.errors import SprintlabError
from sprintlab.core.joystick import Joystick
from sprintlab.deployment.guard.velocity import OPERATOR_RATES, VelocityLimiter
from sprintlab.deployment.messages import FloatArray
from sprintlab.deployment.operators.base import (
    PERIOD,
    CommandSource,
    OperatorCommand,
    Request,
    SourceView,
)

_KEYS = {
    "t": Request.STAND,
    "r": Request.RUN,
    "l": Request.LIE_DOWN,
    "x": Request.STOP,
    "\x1b": Request.STOP,
    "p": Request.PASSIVE,
}
_SEQUENCE = re.compile(r"\x1b(\[\[?[0-9;]*[A-Z~]|O[A-Z])")  # arrows and other keys, which begin as Esc does
_FASTER, _LEFT = np.array([0.5, 0.0, 0.0]), np.array([0.0, 0.0, 0.2])
_STEPS = {"w": _FASTER, "s": -_FASTER, "a": _LEFT, "d": -_LEFT}
_BACKWARD = 0.2  # share of the top speed
SWITCH = 5
"""Number of the dead-man switch, the right shoulder button."""
BUTTONS = {0: Request.STAND, 7: Request.RUN, 1: Request.LIE_DOWN, 2: Request.STOP, 6: Request.PASSIVE}
"""Number of a button to the request it makes: A, Start, B, X, Back."""


class _DeviceSource(CommandSource):
    """A source that a person operates, with a top speed [m/s]; backwards a fifth of it."""

    def __init__(self, top_speed: float) -> None:
        check_positive("top_speed", top_speed, "m/s")
        self._limiter, self._request = VelocityLimiter(top_speed, OPERATOR_RATES), Request.NONE
        self._top_speed = top_speed

    @abstractmethod
    def _poll(self) -> FloatArray | None:
        """Look at the device: the wish ``(3,)``; None if the device is gone."""

    def _ask(self, request: Request) -> None:
        """Note a request; nothing takes a stop back."""
        self._request = max(self._request, request)

    def read(self, view: SourceView) -> OperatorCommand | None:
        """The present wish; None once the device is gone."""
        wish = self._poll()
        if wish is None:
            return None
        if view.mode != "run":
            self._limiter.reset()
            wish = np.zeros(3)
        request, self._request = self._request, Request.NONE
        return OperatorCommand(self._limiter.advance(wish, PERIOD), request)


class KeyboardSource(_DeviceSource):
    """Keys of a terminal, taken one by one without Enter. The terminal is put back when it closes.

    The keys stand in ``docs/deployment.md``; ``p`` is passive after a stop. ``descriptor`` is the terminal's;
    standard input when left out.
    """

    def __init__(self, top_speed: float, descriptor: int | None = None) -> None:
        super().__init__(top_speed)
        self._descriptor = sys.stdin.fileno() if descriptor is None else descriptor
        self._wish = np.zeros(3)
        try:
            self._before = termios.tcgetattr(self._descriptor)
            tty.setcbreak(self._descriptor)
        except (termios.error, OSError) as error:
            raise SprintlabError("the keyboard source needs a terminal as standard input") from error

    def close(self) -> None:
        """Put the terminal back; a second call does nothing."""
        with contextlib.suppress(termios.error, OSError):
            termios.tcsetattr(self._descriptor, termios.TCSADRAIN, self._before)

    def _poll(self) -> FloatArray | None:
        while select.select([self._descriptor], [], [], 0.0)[0]:
            try:
                content = os.read(self._descriptor, 64)
            except OSError:
                content = b""
            if content == b"":
                return None
            for key in _SEQUENCE.sub("", content.decode(errors="ignore")):
                self._press(key)
        return self._wish

    def _press(self, key: str) -> None:
        self._ask(_KEYS.get(key, Request.NONE))
        if key == " " or key in _KEYS:
            self._wish = np.zeros(3)
        lowest = [-_BACKWARD * self._top_speed, 0.0, -1.0]
        self._wish = np.clip(self._wish + _STEPS.get(key, 0.0), lowest, [self._top_speed, 0.0, 1.0])


class GamepadSource(_DeviceSource):
    """A gamepad with a dead-man switch. When it is unplugged or its radio is gone, the source falls silent.

    Letting go of the switch in a run asks for a stand: the robot brakes, and stays there until the switch
    is held and a run is asked for again. A switch that is down when the pad is opened does not count: it may
    be stuck.
    """

    def __init__(self, device: Path, top_speed: float) -> None:
        super().__init__(top_speed)
        self._gripped = False
        self._pad = Joystick(device)

    def _poll(self) -> FloatArray | None:
        for button in self._pad.poll():
            self._ask(BUTTONS.get(button, Request.NONE))
            self._gripped = self._gripped or button == SWITCH
        self._gripped = self._gripped and SWITCH in self._pad.held
        push, turn = self._pad.sticks() if self._gripped else (0.0, 0.0)
        speed = self._top_speed * (push if push > 0.0 else _BACKWARD * push)
        return np.array([speed, 0.0, turn]) if self._pad.connected else None

    def read(self, view: SourceView) -> OperatorCommand | None:
        """The present wish, a stand while the switch is released in a run; None once the device is gone."""
        command = super().read(view)
        if command is None or self._gripped or command.request not in (Request.NONE, Request.RUN):
            return command
        return command._replace(request=Request.STAND if view.mode == "run" else Request.NONE)

    def close(self) -> None:
        """Let go of the device; a second call does nothing."""
        self._pad.close()
