"""Where commanded velocities come from: gamepad, keyboard, profile file, self-paced sprint."""

from sprintlab.deployment.sources.factory import SOURCES, open_source
from sprintlab.deployment.sources.gamepad import GamepadMapping, GamepadSource
from sprintlab.deployment.sources.keyboard import KeyboardSource
from sprintlab.deployment.sources.profile import ProfileSource, VelocityTable, load_velocity_table
from sprintlab.deployment.sources.slew import Slewed, SlewLimits, SourceError
from sprintlab.deployment.sources.sprint import SprintSource

__all__ = [
    "SOURCES",
    "GamepadMapping",
    "GamepadSource",
    "KeyboardSource",
    "ProfileSource",
    "SlewLimits",
    "Slewed",
    "SourceError",
    "SprintSource",
    "VelocityTable",
    "load_velocity_table",
    "open_source",
]
