"""The controller: state machine, policy at 50 Hz, commands at 1 kHz, real-time loop."""

from sprintlab.deployment.controller.controller import Controller as Controller
from sprintlab.deployment.controller.loop import LoopOptions as LoopOptions
from sprintlab.deployment.controller.loop import LoopReport as LoopReport
from sprintlab.deployment.controller.loop import run_loop as run_loop
