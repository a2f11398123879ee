"""Where commanded velocities come from: gamepad, keyboard, profile file, self-paced sprint."""

from sprintlab.deployment.sources.base import SourceError as SourceError
from sprintlab.deployment.sources.factory import open_source as open_source
from sprintlab.deployment.sources.gamepad import GamepadSource as GamepadSource
from sprintlab.deployment.sources.keyboard import KeyboardSource as KeyboardSource
from sprintlab.deployment.sources.profile import ProfileSource as ProfileSource
from sprintlab.deployment.sources.profile import load_velocity_table as load_velocity_table
from sprintlab.deployment.sources.sprint import SprintSource as SprintSource
