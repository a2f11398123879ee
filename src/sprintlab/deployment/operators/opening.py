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
    """Open a command source.

    Args:
        name: one of ``SOURCES``.
        top_speed: highest speed that it wishes for [m/s]; a profile file brings its own.
        distance: length of a sprint [m].
    """
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
