"""mjlab 1.6: the motor as a fusable actuator, the adaptive command scheduler as a command term."""

from sprintlab.integrations.mjlab.actuator import PmsmActuator as PmsmActuator
from sprintlab.integrations.mjlab.actuator import PmsmActuatorCfg as PmsmActuatorCfg
from sprintlab.integrations.mjlab.actuator import actuator_type as actuator_type
from sprintlab.integrations.mjlab.actuator import datasheet_motors as datasheet_motors
from sprintlab.integrations.mjlab.actuator import randomize_bus_voltage as randomize_bus_voltage
from sprintlab.integrations.mjlab.command import AdaptiveVelocityCommand as AdaptiveVelocityCommand
from sprintlab.integrations.mjlab.command import AdaptiveVelocityCommandCfg as AdaptiveVelocityCommandCfg
