"""Where commanded velocities come from: gamepad, keyboard, profile file, self-paced sprint."""

from sprintlab.deployment.operators.opening import open_source as open_source
from sprintlab.deployment.operators.scripts import ProfileSource as ProfileSource
from sprintlab.deployment.operators.scripts import SprintSource as SprintSource
from sprintlab.deployment.operators.scripts import load_velocity_table as load_velocity_table
