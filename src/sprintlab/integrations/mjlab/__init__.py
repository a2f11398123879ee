"""mjlab 1.6: the motor as a fusable actuator, the adaptive command scheduler as a command term."""

from sprintlab.integrations.mjlab.actuator import (
    PmsmActuator,
    PmsmActuatorCfg,
    actuator_type,
    randomize_bus_voltage,
)
from sprintlab.integrations.mjlab.command import AdaptiveVelocityCommand, AdaptiveVelocityCommandCfg

__all__ = [
    "AdaptiveVelocityCommand",
    "AdaptiveVelocityCommandCfg",
    "PmsmActuator",
    "PmsmActuatorCfg",
    "actuator_type",
    "randomize_bus_voltage",
]
