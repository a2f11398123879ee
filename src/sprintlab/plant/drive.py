"""``motors.PreparedDrive`` of a simulated robot with battery, heat and I²t."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from sprintlab.core.array_types import FloatArray
from sprintlab.core.errors import InvalidValueError
from sprintlab.motors import (
    Battery,
    DriveOutput,
    HousedHeat,
    I2tLimit,
    PreparedDrive,
    WindingHeat,
    battery_current,
    discharged,
    i2t_current,
    i2t_decay,
    i2t_level,
    shared_bus_voltage,
    warmed,
    warmed_with_housing,
)
from sprintlab.plant.settings import PlantOptions
from sprintlab.robots import RobotDescription


@dataclass(frozen=True, kw_only=True)
class SupplyState:
    """How battery and windings are."""

    bus_voltage: float  # in the last motor step [V]
    state_of_charge: float  # [-]; 1 for a bus without a battery
    winding_temperature: FloatArray | None  # (joints,) [degC]; None where heat is off
    copper_loss: FloatArray  # (joints,) in the last motor step [W]
    i2t_level: FloatArray | None = None  # (joints,) 1 at continuous current [-]; None without a limit


class SuppliedDrive:
    """Twelve drives on one battery, with windings that warm up and overloads that end; each may be left out.

    Bus voltage and torques of a step agree with each other. Copper loss and current of the step then change
    temperature and charge. The drives set currents by the torque constant at the reference temperature, so
    that warm magnets give less torque than asked for. I²t counts currents, knows no temperature, and is zero
    at the start.

    Raises:
        InvalidValueError: as ``PreparedDrive`` and ``i2t_time_constant`` do, or heat or I²t of a wrong number
            of motors is given.
    """

    def __init__(self, robot: RobotDescription, options: PlantOptions) -> None:
        joints, self._bus_voltage = len(robot.joint_names), options.bus_voltage or robot.bus_voltage
        self._drive = PreparedDrive(robot.motors, robot.gear, self._bus_voltage, options.motor_model)
        _check_motors("heat", options.heat, joints)
        _check_motors("i2t", options.i2t, joints)
        self._heat, self._i2t, self._step = options.heat, options.i2t, 1.0 / options.motor_rate
        self._battery = robot.battery if options.battery == "robot" else options.battery
        if self._i2t is not None:
            self._decay = np.asarray(i2t_decay(self._i2t, robot.motors, self._step))
        self._charge = options.state_of_charge
        self._temperature = np.full(joints, float(options.winding_temperature))
        self._housing = self._temperature
        self._level, self._loss = np.zeros(joints), np.zeros(joints)

    @property
    def state(self) -> SupplyState:
        """Battery and windings now."""
        return SupplyState(
            bus_voltage=self._bus_voltage,
            state_of_charge=self._charge,
            winding_temperature=None if self._heat is None else self._temperature.copy(),
            copper_loss=self._loss,
            i2t_level=None if self._i2t is None else self._level.copy(),
        )

    def __call__(self, desired_joint_torque: FloatArray, joint_velocity: FloatArray) -> DriveOutput:
        """Advance by one step, as ``PreparedDrive`` does, with the motors as warm as they are."""
        desired = desired_joint_torque
        if self._heat is not None:
            desired = desired * self._drive.set_temperature(self._heat, self._temperature)
        if self._i2t is not None:
            continuous = self._i2t.continuous_current
            self._drive.limit_current(i2t_current(continuous, self._level, self._decay))
        if self._battery is not None:
            self._load_bus(self._battery, desired, joint_velocity)
        output = self._drive(desired, joint_velocity)
        self._loss = loss = self._drive.copper_loss(output)
        if isinstance(self._heat, HousedHeat):
            self._temperature, self._housing = warmed_with_housing(
                self._heat, self._temperature, self._housing, loss, self._step
            )
        elif self._heat is not None:
            self._temperature = warmed(self._heat, self._temperature, loss, self._step)
        if self._i2t is not None:
            squared = self._drive.squared_current(output)
            self._level = i2t_level(self._i2t.continuous_current, self._level, squared, self._decay)
        if self._battery is not None:
            power = self._drive.power(output, joint_velocity)
            current = battery_current(self._battery, self._bus_voltage, power)
            self._charge = float(discharged(self._battery, self._charge, current, self._step))
        return output

    def _load_bus(self, battery: Battery, desired: FloatArray, velocity: FloatArray) -> None:
        """Find the bus voltage at which the torques draw just the power that lowers the bus to it."""

        def power_at(voltage: float) -> float:
            self._drive.set_bus_voltage(voltage)
            return self._drive.power(self._drive.currents(desired, velocity), velocity)

        self._bus_voltage = float(shared_bus_voltage(battery, self._charge, power_at, self._bus_voltage))
        self._drive.set_bus_voltage(self._bus_voltage)


def _check_motors(table: str, values: WindingHeat | I2tLimit | None, motors: int) -> None:
    """Refuse a thermal model or limit of another number of motors."""
    for field in () if values is None else fields(values):
        size = np.size(getattr(values, field.name))
        if size not in (1, motors):
            raise InvalidValueError(
                f"{table}.{field.name}", f"{size} numbers", f"give one, or {motors}: one a motor"
            )
