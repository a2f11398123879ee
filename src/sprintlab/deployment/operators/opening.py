"""Command sources by name, as the command line names them."""

from __future__ import annotations

from pathlib import Path

from sprintlab.core.errors import InvalidValueError
from sprintlab.core.joystick import DEFAULT_DEVICE
from sprintlab.deployment.operators.base import CommandSource
from sprintlab.deployment.operators.devices import GamepadSource, KeyboardSource
from sprintlab.deployment.operators.scripts import ProfileSource, SprintSource, load_velocity_table

SOURCES = ("sprint", "sprint-raw", "keyboard", "gamepad", "profile:FILE", "gamepad:DEVICE")
"""What ``open_source`` understands."""


def open_source(name: str, *, top_speed: float, distance: float = 100.0) -> CommandSource:
    """Open one of ``SOURCES``; ``distance`` [m] is a sprint's, and a profile file has its own speeds."""
    kind, _, rest = name.partition(":")
    if name in ("sprint", "sprint-raw"):
        return SprintSource(top_speed, distance, pace=name == "sprint")
    if name == "keyboard":
        return KeyboardSource(top_speed)
    if kind == "gamepad" and (rest or name == kind):
        return GamepadSource(Path(rest or DEFAULT_DEVICE), top_speed)
    if kind == "profile" and rest:
        return ProfileSource(load_velocity_table(Path(rest)))
    raise InvalidValueError("source", name, "choose one of " + ", ".join(SOURCES))
