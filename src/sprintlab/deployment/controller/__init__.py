"""The controller: state machine, policy at 50 Hz, commands at 1 kHz, real-time loop."""

from sprintlab.deployment.controller.controller import Controller
from sprintlab.deployment.controller.loop import LoopOptions, LoopReport, run_loop
from sprintlab.deployment.controller.modes import ACTIVE_MODES, Mode

__all__ = ["ACTIVE_MODES", "Controller", "LoopOptions", "LoopReport", "Mode", "run_loop"]
