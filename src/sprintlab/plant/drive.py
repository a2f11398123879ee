"""The motor law of ``sprintlab.motors.drive_torque``, prepared for one robot and one bus voltage.

The plant asks for twelve torques a thousand times a second; there the checks and conversions of the general
law cost more than the law. This second form has the same equations with the constants taken out, in NumPy
only; a test proves it equal to the first one over random torques and speeds.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sprintlab.core.checks import check_choice, check_positive
from sprintlab.motors import MOTOR_MODELS, DriveOutput, MotorModel, phase_voltage_limit
from sprintlab.robots import RobotDescription

FloatArray = NDArray[np.float64]


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
        motors, gear = robot.motors, robot.gear
        self._square = model == "square"
        self._ratio = np.asarray(gear.ratio, dtype=float)
        self._electrical_ratio = self._ratio * motors.pole_pairs
        inductance = np.asarray(motors.q_axis_inductance, dtype=float)
        self._inductance = inductance if model == "refined" else np.zeros_like(inductance)
        self._reactive_emf = self._inductance * motors.flux_linkage
        self._squared_resistance = np.asarray(motors.stator_resistance, dtype=float) ** 2
        self._voltage = float(phase_voltage_limit(bus_voltage))
        self._torque_constant = np.asarray(motors.torque_constant, dtype=float)
        self._brake = np.asarray(motors.stator_resistance * motors.flux_linkage, dtype=float)
        self._peak = np.asarray(motors.peak_torque, dtype=float)
        self._saturation = np.asarray(motors.saturation / motors.peak_torque, dtype=float)
        self._gain = self._ratio * gear.efficiency

    def __call__(self, desired_joint_torque: FloatArray, joint_velocity: FloatArray) -> DriveOutput:
        """What ``drive_torque`` gives for joint torques [N m] and velocities [rad/s], both ``(12,)``."""
        lower, upper = self.limits(joint_velocity)
        motor_torque = np.minimum(np.maximum(desired_joint_torque / self._ratio, lower), upper)
        torque = motor_torque * (1.0 - self._saturation * np.abs(motor_torque)) * self._gain
        return DriveOutput(torque, motor_torque, lower, upper)

    def limits(self, joint_velocity: FloatArray) -> tuple[FloatArray, FloatArray]:
        """What ``torque_limits`` gives, motor side [N m], for joint velocities [rad/s] ``(12,)``."""
        if self._square:
            return -self._peak, self._peak
        speed = joint_velocity * self._electrical_ratio
        squared_impedance = self._squared_resistance + (speed * self._inductance) ** 2
        across = np.sqrt(squared_impedance) * self._voltage
        reactive = speed * speed * self._reactive_emf
        slack = across - reactive
        scale = self._torque_constant / squared_impedance
        middle = -scale * self._brake * speed
        half_width = scale * np.sqrt(np.maximum(slack, 0.0) * (across + reactive))
        lower, upper = middle - half_width, middle + half_width
        if slack.min() < 0.0:  # over-speed: no current fits; from the least-violating torque to zero
            lower = np.where(slack < 0.0, np.minimum(lower, 0.0), lower)
            upper = np.where(slack < 0.0, np.maximum(upper, 0.0), upper)
        return self._clip(lower), self._clip(upper)

    def _clip(self, torque: FloatArray) -> FloatArray:
        return np.maximum(np.minimum(torque, self._peak), -self._peak)
