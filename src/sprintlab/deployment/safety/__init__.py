"""What keeps the robot, and those around it, whole: monitors, limits, reactions."""

from sprintlab.deployment.safety.age import LinkAge
from sprintlab.deployment.safety.body import BodyMonitor, trunk_tilt
from sprintlab.deployment.safety.faults import RESPONSES, Fault, Reaction, Response
from sprintlab.deployment.safety.guard import CommandGuard, GuardedServo, implied_torque
from sprintlab.deployment.safety.settings import SafetySettings
from sprintlab.deployment.safety.source import SourceMonitor, VelocityLimiter, VelocityLimits
from sprintlab.deployment.safety.states import StateMonitor

__all__ = [
    "RESPONSES",
    "BodyMonitor",
    "CommandGuard",
    "Fault",
    "GuardedServo",
    "LinkAge",
    "Reaction",
    "Response",
    "SafetySettings",
    "SourceMonitor",
    "StateMonitor",
    "VelocityLimiter",
    "VelocityLimits",
    "implied_torque",
    "trunk_tilt",
]
