"""Permanent-magnet motors: what torque they can give at which speed, from their parameters alone."""

from sprintlab.motors.actuator_library import LibraryMotor, LibraryValue, library_motors, load_library_motor
from sprintlab.motors.arrays import Array
from sprintlab.motors.battery import (
    Battery,
    battery_current,
    discharged,
    loaded_voltage,
    open_circuit_voltage,
    shared_bus_voltage,
)
from sprintlab.motors.drive import DriveOutput, drive_torque
from sprintlab.motors.envelope import (
    MOTOR_MODELS,
    MotorModel,
    critical_speed,
    no_load_speed,
    prepared_torque_limits,
    torque_limits,
    voltage_infeasible,
)
from sprintlab.motors.files import load_motor, save_motor
from sprintlab.motors.flux_weakening import DqCurrents, dq_currents, mtpv_currents, weakening_current
from sprintlab.motors.gear import (
    TURNING_SPEED,
    Gear,
    joint_torque,
    motor_speed,
    reflected_inertia,
    shaft_torque,
)
from sprintlab.motors.i2t import (
    I2tLimit,
    i2t_current,
    i2t_decay,
    i2t_drive,
    i2t_level,
    i2t_time_constant,
    squared_current,
)
from sprintlab.motors.parameters import MotorValues, PmsmParameters, motor_like, single, stack_motors
from sprintlab.motors.power import copper_loss, electrical_power
from sprintlab.motors.saturation import desaturate, saturate
from sprintlab.motors.supply_files import SupplyFile, load_supply, save_supply
from sprintlab.motors.thermal import (
    COPPER_COEFFICIENT,
    HousedHeat,
    WindingHeat,
    flux_factor,
    heated_motor,
    resistance_factor,
    warmed,
    warmed_with_housing,
)
from sprintlab.motors.voltage import VOLTAGE_UTILIZATION, phase_voltage_limit

__all__ = [
    "COPPER_COEFFICIENT",
    "MOTOR_MODELS",
    "TURNING_SPEED",
    "VOLTAGE_UTILIZATION",
    "Array",
    "Battery",
    "DqCurrents",
    "DriveOutput",
    "Gear",
    "HousedHeat",
    "I2tLimit",
    "LibraryMotor",
    "LibraryValue",
    "MotorModel",
    "MotorValues",
    "PmsmParameters",
    "SupplyFile",
    "WindingHeat",
    "battery_current",
    "copper_loss",
    "critical_speed",
    "desaturate",
    "discharged",
    "dq_currents",
    "drive_torque",
    "electrical_power",
    "flux_factor",
    "heated_motor",
    "i2t_current",
    "i2t_decay",
    "i2t_drive",
    "i2t_level",
    "i2t_time_constant",
    "joint_torque",
    "library_motors",
    "load_library_motor",
    "load_motor",
    "load_supply",
    "loaded_voltage",
    "motor_like",
    "motor_speed",
    "mtpv_currents",
    "no_load_speed",
    "open_circuit_voltage",
    "phase_voltage_limit",
    "prepared_torque_limits",
    "reflected_inertia",
    "resistance_factor",
    "saturate",
    "save_motor",
    "save_supply",
    "shaft_torque",
    "shared_bus_voltage",
    "single",
    "squared_current",
    "stack_motors",
    "torque_limits",
    "voltage_infeasible",
    "warmed",
    "warmed_with_housing",
    "weakening_current",
]
