"""The law of ``drive_torque`` with its constants taken out, for loops that ask a thousand times a second.

The same equations in NumPy only, without the checks and conversions of the general law, which cost more than
the law itself; a test proves both equal over random torques, speeds and voltages. A motor model without a
fast form here is computed by the general law.
"""

from __future__ import annotations

import numpy as np

from sprintlab.core.array_types import FloatArray
from sprintlab.core.checks import check_choice, check_positive
from sprintlab.motors.drive import DriveOutput
from sprintlab.motors.envelope import MOTOR_MODELS, MotorModel, torque_limits
from sprintlab.motors.flux_weakening import weakening_current
from sprintlab.motors.gear import TURNING_SPEED, Gear
from sprintlab.motors.parameters import PmsmParameters, unchecked
from sprintlab.motors.thermal import WindingHeat, flux_factor, heated_motor, resistance_factor
from sprintlab.motors.voltage import phase_voltage_limit

_FAST_MODELS = ("refined", "simplified-dc", "square")


class PreparedDrive:
    """All drives of a robot on one bus: motors and gears ``(joints,)``, a bus voltage [V].

    Models without a fast form here call ``torque_limits``.
    """

    def __init__(
        self, motors: PmsmParameters, gear: Gear, bus_voltage: float, model: MotorModel = "refined"
    ) -> None:
        check_positive("bus_voltage", bus_voltage, "V")
        check_choice("model", model, MOTOR_MODELS)
        self._model: MotorModel = model
        self._general = model not in _FAST_MODELS
        self._ratio = np.asarray(gear.ratio, dtype=float)
        self._gear_loss = np.log(np.asarray(gear.efficiency, dtype=float))
        self._cold_motors = self._warm_motors = self._motors = motors
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
        """Go on with the ``heated_motor`` of windings at ``temperature`` ``(joints,)`` [degC].

        What is left of the flux ``(joints,)`` [-] is returned.
        """
        cold = self._cold_motors
        if self._general:
            self._warm_motors = self._motors = heated_motor(cold, heat, temperature)
        flux = flux_factor(heat, temperature)
        resistance = cold.stator_resistance * resistance_factor(heat, temperature)
        self._set_windings(resistance, cold.flux_linkage * flux, cold.peak_torque * flux)
        return flux

    def limit_current(self, current: FloatArray) -> None:
        """Go on with a current limit ``(joints,)`` [A] in place of the peak current where it is lower."""
        self._limit = np.minimum(self._peak, self._torque_constant * current)
        self._least = -self._limit
        if self._general:
            self._motors = unchecked(PmsmParameters, {**vars(self._warm_motors), "peak_torque": self._limit})

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
        """What ``copper_loss`` gives for what the drives gave ``(joints,)`` [W]."""
        return 1.5 * self._resistance * self.squared_current(output)

    def squared_current(self, output: DriveOutput) -> FloatArray:
        """``i_d^2 + i_q^2`` of what the drives gave ``(joints,)`` [A^2]."""
        return (output.motor_torque / self._torque_constant) ** 2 + output.direct_current**2

    def power(self, output: DriveOutput, joint_velocity: FloatArray) -> float:
        """What all drives draw from the bus [W]: the sum of ``electrical_power``."""
        shaft = output.motor_torque * (1.0 - self._saturation * np.abs(output.motor_torque))
        return float((shaft * joint_velocity * self._ratio + self.copper_loss(output)).sum())

    def limits(self, joint_velocity: FloatArray) -> tuple[FloatArray, FloatArray]:
        """What ``torque_limits`` gives, motor side [N m], for joint velocities [rad/s] ``(joints,)``."""
        if self._model == "square":
            return self._least, self._limit
        if self._general:
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
