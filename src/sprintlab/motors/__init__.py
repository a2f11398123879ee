"""Permanent-magnet motors: what torque they can give at which speed, from their parameters alone."""

from sprintlab.motors.arrays import Array
from sprintlab.motors.drive import DriveOutput, drive_torque
from sprintlab.motors.envelope import (
    MOTOR_MODELS,
    MotorModel,
    critical_speed,
    no_load_speed,
    torque_limits,
    voltage_infeasible,
)
from sprintlab.motors.files import load_motor, save_motor
from sprintlab.motors.gear import Gear, joint_torque, motor_speed, reflected_inertia
from sprintlab.motors.parameters import PmsmParameters, motor_like, stack_motors
from sprintlab.motors.power import copper_loss, electrical_power
from sprintlab.motors.saturation import desaturate, saturate
from sprintlab.motors.voltage import VOLTAGE_UTILIZATION, phase_voltage_limit

__all__ = [
    "MOTOR_MODELS",
    "VOLTAGE_UTILIZATION",
    "Array",
    "DriveOutput",
    "Gear",
    "MotorModel",
    "PmsmParameters",
    "copper_loss",
    "critical_speed",
    "desaturate",
    "drive_torque",
    "electrical_power",
    "joint_torque",
    "load_motor",
    "motor_like",
    "motor_speed",
    "no_load_speed",
    "phase_voltage_limit",
    "reflected_inertia",
    "saturate",
    "save_motor",
    "stack_motors",
    "torque_limits",
    "voltage_infeasible",
]
