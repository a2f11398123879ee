"""Permanent-magnet motors: what torque they can give at which speed, from their parameters alone.

Unless a docstring says otherwise, quantities are on the motor's side of the gear; arguments, and the fields
of motors and gears, are numbers or arrays (NumPy, PyTorch) that broadcast, and results have the broadcast
shape. ``speed`` is mechanical [rad/s], ``torque`` and ``motor_torque`` are before saturation [N m],
``bus_voltage`` is the DC bus [V], ``model`` is one of ``MOTOR_MODELS``. An unknown model, or a bus voltage
that is a negative Python number, raises ``InvalidValueError``.
"""

from sprintlab.motors.actuator_library import LibraryMotor as LibraryMotor
from sprintlab.motors.actuator_library import library_motors as library_motors
from sprintlab.motors.actuator_library import load_library_motor as load_library_motor
from sprintlab.motors.arrays import Array as Array
from sprintlab.motors.battery import Battery as Battery
from sprintlab.motors.battery import battery_current as battery_current
from sprintlab.motors.battery import discharged as discharged
from sprintlab.motors.battery import loaded_voltage as loaded_voltage
from sprintlab.motors.battery import open_circuit_voltage as open_circuit_voltage
from sprintlab.motors.battery import shared_bus_voltage as shared_bus_voltage
from sprintlab.motors.drive import DriveOutput as DriveOutput
from sprintlab.motors.drive import drive_torque as drive_torque
from sprintlab.motors.envelope import MOTOR_MODELS as MOTOR_MODELS
from sprintlab.motors.envelope import MotorModel as MotorModel
from sprintlab.motors.envelope import critical_speed as critical_speed
from sprintlab.motors.envelope import no_load_speed as no_load_speed
from sprintlab.motors.envelope import torque_limits as torque_limits
from sprintlab.motors.envelope import voltage_infeasible as voltage_infeasible
from sprintlab.motors.files import SupplyFile as SupplyFile
from sprintlab.motors.files import load_motor as load_motor
from sprintlab.motors.files import load_supply as load_supply
from sprintlab.motors.files import save_motor as save_motor
from sprintlab.motors.flux_weakening import dq_currents as dq_currents
from sprintlab.motors.gear import TURNING_SPEED as TURNING_SPEED
from sprintlab.motors.gear import Gear as Gear
from sprintlab.motors.gear import joint_torque as joint_torque
from sprintlab.motors.gear import motor_speed as motor_speed
from sprintlab.motors.gear import reflected_inertia as reflected_inertia
from sprintlab.motors.gear import shaft_torque as shaft_torque
from sprintlab.motors.parameters import PmsmParameters as PmsmParameters
from sprintlab.motors.parameters import single as single
from sprintlab.motors.parameters import stack_motors as stack_motors
from sprintlab.motors.parameters import unchecked as unchecked
from sprintlab.motors.power import copper_loss as copper_loss
from sprintlab.motors.power import electrical_power as electrical_power
from sprintlab.motors.prepared import PreparedDrive as PreparedDrive
from sprintlab.motors.saturation import desaturate as desaturate
from sprintlab.motors.saturation import saturate as saturate
from sprintlab.motors.thermal import COPPER_COEFFICIENT as COPPER_COEFFICIENT
from sprintlab.motors.thermal import HousedHeat as HousedHeat
from sprintlab.motors.thermal import I2tLimit as I2tLimit
from sprintlab.motors.thermal import WindingHeat as WindingHeat
from sprintlab.motors.thermal import flux_factor as flux_factor
from sprintlab.motors.thermal import heated_motor as heated_motor
from sprintlab.motors.thermal import i2t_current as i2t_current
from sprintlab.motors.thermal import i2t_decay as i2t_decay
from sprintlab.motors.thermal import i2t_drive as i2t_drive
from sprintlab.motors.thermal import i2t_level as i2t_level
from sprintlab.motors.thermal import i2t_time_constant as i2t_time_constant
from sprintlab.motors.thermal import resistance_factor as resistance_factor
from sprintlab.motors.thermal import squared_current as squared_current
from sprintlab.motors.thermal import warmed as warmed
from sprintlab.motors.thermal import warmed_with_housing as warmed_with_housing
from sprintlab.motors.voltage import phase_voltage_limit as phase_voltage_limit
