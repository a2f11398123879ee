"""Steering with a gamepad: what its sticks and buttons mean to the controller."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np

from sprintlab.core.checks import check_positive
from sprintlab.core.joystick import DEFAULT_DEVICE, Joystick, JoystickError
from sprintlab.deployment.interface import FloatArray, OperatorCommand, Request, SourceView
from sprintlab.deployment.sources.base import OperatorSource, SourceError

SWITCH = 5
"""Number of the dead-man switch, the right shoulder button."""
BUTTONS = {0: Request.STAND, 7: Request.RUN, 1: Request.LIE_DOWN, 2: Request.STOP, 6: Request.PASSIVE}
"""Number of a button to the request it makes: A, Start, B, X, Back."""


class GamepadSource(OperatorSource):
    """A gamepad with a dead-man switch. When it is unplugged or its radio is gone, the source falls silent.

    Letting go of the switch in a run asks for a stand: the robot brakes, and stays there until the switch
    is held and a run is asked for again. A switch that is down when the pad is opened does not count: it may
    be stuck.

    Args:
        device: the joystick device.
        top_speed: with the stick fully forward [m/s]; backwards a fifth of it.

    Raises:
        SourceError: there is no such device, it may not be read, or it is something else.
        InvalidValueError: the speed is not positive.
    """

    def __init__(self, device: Path = DEFAULT_DEVICE, top_speed: float = 6.0) -> None:
        check_positive("gamepad.top_speed", top_speed, "m/s")
        super().__init__()
        self._top_speed, self._gripped = top_speed, False
        try:
            self._pad = Joystick(device)
        except JoystickError as error:
            raise SourceError(str(error)) from error

    def poll(self) -> FloatArray | None:
        """Take the events since the last look; None once the pad is gone."""
        for button in self._pad.poll():
            self._ask(BUTTONS.get(button, Request.NONE))
            self._gripped = self._gripped or button == SWITCH
        self._gripped = self._gripped and SWITCH in self._pad.held
        push, turn = self._pad.sticks() if self._gripped else (0.0, 0.0)
        speed = self._top_speed * (push if push > 0.0 else 0.2 * push)
        return np.array([speed, 0.0, turn]) if self._pad.connected else None

    def read(self, view: SourceView) -> OperatorCommand | None:
        """The present wish, a stand while the switch is released in a run; None once the device is gone."""
        command = super().read(view)
        if command is None or self._gripped:
            return command
        if view.mode == "run" and command.request in (Request.NONE, Request.RUN):
            return msgspec.structs.replace(command, request=Request.STAND)
        if command.request == Request.RUN:
            return msgspec.structs.replace(command, request=Request.NONE)
        return command

    def close(self) -> None:
        """Let go of the device; a second call does nothing."""
        self._pad.close()
