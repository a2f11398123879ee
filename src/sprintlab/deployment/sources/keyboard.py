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
from sprintlab.deployment.sources.operator import OperatorSource
from sprintlab.deployment.sources.slew import SlewLimits, SourceError

_REQUESTS = {
    "t": Request.STAND,
    "r": Request.RUN,
    "l": Request.LIE_DOWN,
    "x": Request.STOP,
    "\x1b": Request.STOP,
    "p": Request.PASSIVE,
}
_SEQUENCE = re.compile(r"\x1b(\[\[?[0-9;]*[A-Z~]|O[A-Z])")  # of an arrow and other keys, which are no Esc
_STEPS = {"w": (0.5, 0.0), "s": (-0.5, 0.0), "a": (0.0, 0.2), "d": (0.0, -0.2)}


class KeyboardSource(OperatorSource):
    """Keys of a terminal, taken one by one without Enter. The terminal is put back when it closes.

    Args:
        top_speed: highest wish [m/s]; backwards a fifth of it.
        limits: slew limits.
        descriptor: the terminal's file descriptor.

    Raises:
        SourceError: standard input is no terminal.
        InvalidValueError: the speed is not positive.
    """

    def __init__(
        self, top_speed: float = 6.0, limits: SlewLimits | None = None, descriptor: int | None = None
    ) -> None:
        check_positive("keyboard.top_speed", top_speed, "m/s")
        super().__init__(limits)
        self._descriptor = sys.stdin.fileno() if descriptor is None else descriptor
        self._lowest = np.array([-0.2 * top_speed, 0.0, -1.0])
        self._highest = np.array([top_speed, 0.0, 1.0])
        self._wish = np.zeros(3)
        self._gone = False
        try:
            self._before = termios.tcgetattr(self._descriptor)
            tty.setcbreak(self._descriptor)
        except (termios.error, OSError) as error:
            raise SourceError("the keyboard source needs a terminal as standard input") from error

    def poll(self) -> FloatArray | None:
        """Take the keys pressed since the last look; None once the terminal is gone."""
        while not self._gone and select.select([self._descriptor], [], [], 0.0)[0]:
            try:
                content = os.read(self._descriptor, 64)
            except OSError:
                content = b""
            self._gone = content == b""  # bytes that are no text, as of half a letter, are no end
            self._press(content.decode(errors="ignore"))
        return None if self._gone else self._wish

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
                self._wish = self._wish * np.array([1.0, 1.0, 0.0])
            faster, turn = _STEPS.get(key, (0.0, 0.0))
            self._wish = np.clip(self._wish + np.array([faster, 0.0, turn]), self._lowest, self._highest)
