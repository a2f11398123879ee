"""Steering from the terminal; the keys stand in ``docs/deployment.md``, and ``p`` is passive after a stop."""

from __future__ import annotations

import contextlib
import os
import re
import select
import sys
import termios
import tty

import numpy as np

from sprintlab.core.checks import check_positive
from sprintlab.deployment.interface import FloatArray, Request
from sprintlab.deployment.sources.base import OperatorSource, SourceError

_REQUESTS = {
    "t": Request.STAND,
    "r": Request.RUN,
    "l": Request.LIE_DOWN,
    "x": Request.STOP,
    "\x1b": Request.STOP,
    "p": Request.PASSIVE,
}
_SEQUENCE = re.compile(r"\x1b(\[\[?[0-9;]*[A-Z~]|O[A-Z])")  # of an arrow and other keys, which are no Esc
_FASTER, _LEFT = np.array([0.5, 0.0, 0.0]), np.array([0.0, 0.0, 0.2])
_STEPS = {"w": _FASTER, "s": -_FASTER, "a": _LEFT, "d": -_LEFT}


class KeyboardSource(OperatorSource):
    """Keys of a terminal, taken one by one without Enter. The terminal is put back when it closes.

    Args:
        top_speed: highest wish [m/s]; backwards a fifth of it.
        descriptor: the terminal's file descriptor; standard input when left out.

    Raises:
        SourceError: it is no terminal.
        InvalidValueError: the speed is not positive.
    """

    def __init__(self, top_speed: float = 6.0, descriptor: int | None = None) -> None:
        check_positive("keyboard.top_speed", top_speed, "m/s")
        super().__init__()
        self._descriptor = sys.stdin.fileno() if descriptor is None else descriptor
        self._lowest = np.array([-0.2 * top_speed, 0.0, -1.0])
        self._highest = np.array([top_speed, 0.0, 1.0])
        self._wish = np.zeros(3)
        try:
            self._before = termios.tcgetattr(self._descriptor)
            tty.setcbreak(self._descriptor)
        except (termios.error, OSError) as error:
            raise SourceError("the keyboard source needs a terminal as standard input") from error

    def poll(self) -> FloatArray | None:
        """Take the keys pressed since the last look; None once the terminal is gone."""
        while select.select([self._descriptor], [], [], 0.0)[0]:
            try:
                content = os.read(self._descriptor, 64)
            except OSError:
                content = b""
            if content == b"":
                return None
            self._press(content.decode(errors="ignore"))
        return self._wish

    def close(self) -> None:
        """Put the terminal back; a second call does nothing."""
        with contextlib.suppress(termios.error, OSError):
            termios.tcsetattr(self._descriptor, termios.TCSADRAIN, self._before)

    def _press(self, keys: str) -> None:
        for key in _SEQUENCE.sub("", keys):
            self._ask(_REQUESTS.get(key, Request.NONE))
            if key == " " or key in _REQUESTS:
                self._wish = np.zeros(3)
            if key == "q":
                self._wish = self._wish * [1.0, 1.0, 0.0]
            self._wish = np.clip(self._wish + _STEPS.get(key, 0.0), self._lowest, self._highest)
