"""The motor law of ``sprintlab.motors.drive_torque``, prepared for one robot and one bus voltage.

The plant asks for twelve torques a thousand times a second; there the checks and conversions of the general
law cost more than the law. This second form has the same equations with the constants taken out, in NumPy
only; a test proves it equal to the first one over random torques and speeds. Flux weakening, which no
published number uses, calls the general law. ``SuppliedDrive`` adds battery, heat and I²t.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import cast

import numpy as np

from sprintlab.core.array_types import FloatArray
from sprintlab.core.checks import check_choice, check_positive
from sprintlab.core.errors import InvalidValueError
from sprintlab.motors import (
    MOTOR_MODELS,
    TURNING_SPEED,
    Battery,
    DriveOutput,
    HousedHeat,
    I2tLimit,
    MotorModel,
    MotorValues,
    PmsmParameters,
    WindingHeat,
    battery_current,
    discharged,
    flux_factor,
    heated_motor,
    i2t_current,
    i2t_decay,
    i2t_level,
    phase_voltage_limit,
    resistance_factor,
    shared_bus_voltage,
    torque_limits,
    warmed,
    warmed_with_housing,
    weakening_current,
)
from sprintlab.robots import RobotDescription


class PreparedDrive:
    """Twelve drives on one bus.

    Args:
        robot: its motors and gears.
        bus_voltage: [V].
        model: one of ``sprintlab.motors.MOTOR_MODELS``.

    Raises:
        InvalidValueError: the voltage is not positive or the model is unknown.
    """

    def __init__(self, robot: RobotDescription, bus_voltage: float, model: MotorModel = "refined") -> None:
        check_positive("bus_voltage", bus_voltage, "V")
        check_choice("model", model, MOTOR_MODELS)
        self._model = model
        self._ratio = np.asarray(robot.gear.ratio, dtype=float)
        self._gear_loss = np.log(np.asarray(robot.gear.efficiency, dtype=float))
        self._cold_motors = self._warm_motors = self._motors = motors = robot.motors
        self._electrical_ratio = self._ratio * motors.pole_pairs
        inductance = np.asarray(motors.q_axis_inductance, dtype=float)
        self._inductance = inductance if model == "refined" else np.zeros_like(inductance)
        self._set_windings(motors.stator_resistance, motors.flux_linkage, motors.peak_torque)
        self.set_bus_voltage(bus_voltage)

    def set_bus_voltage(self, bus_voltage: float) -> None:
        """Go on with another bus voltage [V], not negative."""
        self._bus_voltage = bus_voltage
        self._voltage = float(phase_voltage_limit(bus_voltage))

    def set_temperature(self, heat: WindingHeat, temperature: FloatArray) -> FloatArray:
        """Go on with the motors that windings at ``temperature`` ``(12,)`` [degC] make: ``heated_motor``.

        Returns:
            What is left of the flux ``(12,)`` [-].
        """
        cold = self._cold_motors
        if self._model == "flux-weakening":
            self._warm_motors = self._motors = heated_motor(cold, heat, temperature)
        flux = flux_factor(heat, temperature)
        resistance = cold.stator_resistance * resistance_factor(heat, temperature)
        self._set_windings(resistance, cold.flux_linkage * flux, cold.peak_torque * flux)
        return flux

    def limit_current(self, current: FloatArray) -> None:
        """Go on with a current limit ``(joints,)`` [A] in place of the peak current where it is lower."""
        self._limit = np.minimum(self._peak, self._torque_constant * current)
        self._least = -self._limit
        if self._model == "flux-weakening":
            limited = MotorValues.of(self._warm_motors)._replace(peak_torque=self._limit)
            self._motors = cast("PmsmParameters", limited)

    def _set_windings(
        self, resistance: FloatArray, flux_linkage: FloatArray, peak_torque: FloatArray
    ) -> None:
        self._resistance = np.asarray(resistance, dtype=float)
        self._squared_resistance = self._resistance**2
        self._reactive_emf = self._inductance * flux_linkage
        self._torque_constant = np.asarray(1.5 * self._cold_motors.pole_pairs * flux_linkage, dtype=float)
        self._brake = np.asarray(resistance * flux_linkage, dtype=float)
        self._peak = self._limit = np.asarray(peak_torque, dtype=float)
        self._least = -self._limit
        self._saturation = np.asarray(self._cold_motors.saturation / peak_torque, dtype=float)

    def __call__(self, desired_joint_torque: FloatArray, joint_velocity: FloatArray) -> DriveOutput:
        """What ``drive_torque`` gives for joint torques [N m] and velocities [rad/s], both ``(joints,)``."""
        output = self.currents(desired_joint_torque, joint_velocity)
        motor_torque = output.motor_torque
        shaft = motor_torque * (1.0 - self._saturation * np.abs(motor_torque))
        direction = np.sign(shaft) * np.tanh(joint_velocity * (1.0 / TURNING_SPEED))
        return output._replace(torque=shaft * self._ratio * np.exp(self._gear_loss * direction))

    def currents(self, desired_joint_torque: FloatArray, joint_velocity: FloatArray) -> DriveOutput:
        """The same without what becomes of it behind the motors: ``torque`` is NaN."""
        lower, upper = self.limits(joint_velocity)
        motor_torque = np.minimum(np.maximum(desired_joint_torque / self._ratio, lower), upper)
        direct = 0.0
        if self._model == "flux-weakening":
            speed = joint_velocity * self._ratio
            direct = weakening_current(self._motors, motor_torque, speed, self._bus_voltage)
        return DriveOutput(np.nan, motor_torque, lower, upper, direct)

    def copper_loss(self, output: DriveOutput) -> FloatArray:
        """What ``sprintlab.motors.copper_loss`` gives for what the drives gave ``(12,)`` [W]."""
        return 1.5 * self._resistance * self.squared_current(output)

    def squared_current(self, output: DriveOutput) -> FloatArray:
        """``i_d^2 + i_q^2`` of what the drives gave ``(joints,)`` [A^2]."""
        return (output.motor_torque / self._torque_constant) ** 2 + output.direct_current**2

    def power(self, output: DriveOutput, joint_velocity: FloatArray) -> float:
        """What all drives draw from the bus [W]: the sum of ``sprintlab.motors.electrical_power``."""
        shaft = output.motor_torque * (1.0 - self._saturation * np.abs(output.motor_torque))
        return float((shaft * joint_velocity * self._ratio + self.copper_loss(output)).sum())

    def limits(self, joint_velocity: FloatArray) -> tuple[FloatArray, FloatArray]:
        """What ``torque_limits`` gives, motor side [N m], for joint velocities [rad/s] ``(joints,)``."""
        if self._model == "square":
            return self._least, self._limit
        if self._model == "flux-weakening":
            return torque_limits(self._motors, joint_velocity * self._ratio, self._bus_voltage, self._model)
        speed = joint_velocity * self._electrical_ratio
        squared_impedance = self._squared_resistance + (speed * self._inductance) ** 2
        across = np.sqrt(squared_impedance) * self._voltage
        reactive = speed * speed * self._reactive_emf
        slack = across - reactive
        scale = self._torque_constant / squared_impedance
        middle = -scale * self._brake * speed
        half_width = scale * np.sqrt(np.maximum(slack, 0.0) * (across + reactive))
        lower, upper = middle - half_width, middle + half_width
        return self._clip(lower), self._clip(upper)

    def _clip(self, torque: FloatArray) -> FloatArray:
        return np.maximum(np.minimum(torque, self._limit), self._least)


@dataclass(frozen=True, kw_only=True)
class SupplyState:
    """How battery and windings are.

    Attributes:
        bus_voltage: in the last motor step [V].
        lowest_bus_voltage: so far [V].
        state_of_charge: [-]; 1 for a bus without a battery.
        winding_temperature: ``(joints,)`` [degC]; ``None`` where heat is off.
        housing_temperature: ``(joints,)`` [degC]; ``None`` where heat has one node.
        copper_loss: ``(joints,)``, in the last motor step [W].
        i2t_level: ``(joints,)``, 1 where only the continuous current is left [-]; ``None`` without a limit.
    """

    bus_voltage: float
    lowest_bus_voltage: float
    state_of_charge: float
    winding_temperature: FloatArray | None
    copper_loss: FloatArray
    housing_temperature: FloatArray | None = None
    i2t_level: FloatArray | None = None


class SuppliedDrive:
    """Twelve drives on one battery, with windings that warm up and overloads that end; each may be left out.

    Bus voltage and torques of a step agree with each other. Copper loss and current of the step then change
    temperature and charge. The drives set currents by the torque constant at the reference temperature, so
    that warm magnets give less torque than asked for. I²t counts currents and knows no temperature.

    Args:
        robot: its motors and gears.
        bus_voltage: without a battery [V].
        model: one of ``sprintlab.motors.MOTOR_MODELS``.
        battery: ``None``: the bus holds ``bus_voltage``.
        state_of_charge: of the battery at the start [-].
        heat: ``None``: the windings stay as the motors' parameters say.
        winding_temperature: at the start, of a housing too [degC].
        i2t: ``None``: the peak current may flow for ever. The drives are cold at the start.
        step: time between two calls [s].

    Raises:
        InvalidValueError: as ``PreparedDrive`` and ``i2t_time_constant`` do, or heat or I²t of a wrong number
            of motors is given.
    """

    def __init__(
        self,
        robot: RobotDescription,
        bus_voltage: float,
        model: MotorModel = "refined",
        *,
        battery: Battery | None = None,
        state_of_charge: float = 1.0,
        heat: WindingHeat | None = None,
        winding_temperature: float = 25.0,
        i2t: I2tLimit | None = None,
        step: float = 0.001,
    ) -> None:
        self._drive = PreparedDrive(robot, bus_voltage, model)
        _check_motors("heat", heat, len(robot.joint_names))
        _check_motors("i2t", i2t, len(robot.joint_names))
        self._i2t, self._level = i2t, np.zeros(len(robot.joint_names))
        if i2t is not None:
            self._decay = np.asarray(i2t_decay(i2t, robot.motors, step))
        self._battery, self._heat, self._step = battery, heat, step
        self._bus_voltage, self._lowest = bus_voltage, np.inf
        self._charge = state_of_charge
        self._temperature = np.full(len(robot.joint_names), float(winding_temperature))
        self._housing = self._temperature
        self._loss = np.zeros(len(robot.joint_names))

    @property
    def state(self) -> SupplyState:
        """Battery and windings now."""
        return SupplyState(
            bus_voltage=self._bus_voltage,
            lowest_bus_voltage=min(self._lowest, self._bus_voltage),
            state_of_charge=self._charge,
            winding_temperature=None if self._heat is None else self._temperature.copy(),
            copper_loss=self._loss,
            housing_temperature=self._housing.copy() if isinstance(self._heat, HousedHeat) else None,
            i2t_level=None if self._i2t is None else self._level.copy(),
        )

    def __call__(self, desired_joint_torque: FloatArray, joint_velocity: FloatArray) -> DriveOutput:
        """Advance by one step; arguments and result as of ``PreparedDrive``, the motors as warm as they are.

        Args:
            desired_joint_torque: ``(joints,)`` [N m].
            joint_velocity: ``(joints,)`` [rad/s].
        """
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
        if self._heat is not None:
            self._warm(self._heat, loss)
        if self._i2t is not None:
            squared = self._drive.squared_current(output)
            self._level = i2t_level(self._i2t.continuous_current, self._level, squared, self._decay)
        if self._battery is not None:
            power = self._drive.power(output, joint_velocity)
            current = battery_current(self._battery, self._bus_voltage, power)
            self._charge = float(discharged(self._battery, self._charge, current, self._step))
        return output

    def _warm(self, heat: WindingHeat, loss: FloatArray) -> None:
        """Let a step's copper loss [W] ``(joints,)`` flow."""
        if isinstance(heat, HousedHeat):
            self._temperature, self._housing = warmed_with_housing(
                heat, self._temperature, self._housing, loss, self._step
            )
        else:
            self._temperature = warmed(heat, self._temperature, loss, self._step)

    def _load_bus(self, battery: Battery, desired: FloatArray, velocity: FloatArray) -> None:
        """Find the bus voltage at which the torques draw just the power that lowers the bus to it."""

        def power_at(voltage: float) -> float:
            self._drive.set_bus_voltage(voltage)
            return self._drive.power(self._drive.currents(desired, velocity), velocity)

        self._bus_voltage = float(shared_bus_voltage(battery, self._charge, power_at, self._bus_voltage))
        self._lowest = min(self._lowest, self._bus_voltage)
        self._drive.set_bus_voltage(self._bus_voltage)


def _check_motors(table: str, values: WindingHeat | I2tLimit | None, motors: int) -> None:
    """Refuse a thermal model or limit of another number of motors."""
    for field in () if values is None else fields(values):
        size = np.size(getattr(values, field.name))
        if size not in (1, motors):
            raise InvalidValueError(
                f"{table}.{field.name}", f"{size} numbers", f"give one, or {motors}: one a motor"
            )
