"""Faults that a good state tells of: falls, joints beyond their bounds, the bus, the drives."""

from __future__ import annotations

import math

import numpy as np

from sprintlab.deployment.interface import RobotState, RobotStatus
from sprintlab.deployment.safety.faults import Fault
from sprintlab.deployment.safety.settings import SafetySettings
from sprintlab.deployment.safety.timer import Persistence
from sprintlab.motors import no_load_speed
from sprintlab.robots import RobotDescription


def trunk_tilt(state: RobotState) -> float:
    """Angle between the trunk's vertical axis and the world's [degrees]."""
    _, x, y, _ = state.quaternion.tolist()
    return math.degrees(math.acos(min(1.0, max(-1.0, 1.0 - 2.0 * (x * x + y * y)))))


class BodyMonitor:
    """Watches the accepted states of one robot."""

    def __init__(self, robot: RobotDescription, settings: SafetySettings) -> None:
        self._settings = settings
        lower, upper = robot.position_limits.T
        lower, upper = lower - settings.limit_margin, upper + settings.limit_margin
        # Twelve numbers are compared in half the time that NumPy needs to begin.
        self._bounds = list(zip(lower.tolist(), upper.tolist(), strict=True))
        ratio = np.asarray(robot.gear.ratio)
        no_load = np.asarray(no_load_speed(robot.motors, robot.bus_voltage)) / ratio
        self._highest_speed = np.broadcast_to(settings.overspeed_ratio * no_load, lower.shape).tolist()
        torque = settings.overtorque_ratio * np.asarray(robot.motors.peak_torque) * ratio
        self._highest_torque = np.broadcast_to(torque, lower.shape).tolist()
        self._voltage = robot.bus_voltage
        self._legs = robot.leg_joints
        self._links = (robot.mechanics.thigh_length, robot.mechanics.shank_length)
        self._lowest_extension = settings.collapse_height * self._extension(robot.default_pose)
        self.reset()

    def reset(self) -> None:
        """Forget how long anything has lasted."""
        s = self._settings
        self._timers = {
            Fault.JOINT_LIMIT: Persistence(s.limit_time),
            Fault.OVERSPEED: Persistence(s.limit_time),
            Fault.OVERTORQUE: Persistence(s.overtorque_time),
            Fault.BUS_LOW: Persistence(s.bus_low_time),
            Fault.BUS_HIGH: Persistence(s.bus_high_time),
            Fault.FALL: Persistence(s.fall_time),
            Fault.COLLAPSE: Persistence(s.collapse_time),
            Fault.TUMBLE: Persistence(s.tumble_time),
        }

    def check(self, state: RobotState, time: float, *, carried: bool) -> list[Fault]:
        """Faults that ``state`` shows.

        Args:
            state: an accepted state.
            time: controller's clock [s].
            carried: whether the legs are meant to carry the trunk: then a collapse is a fault.
        """
        conditions = {
            Fault.JOINT_LIMIT: self._beyond_limits(state),
            Fault.OVERSPEED: _any_above(state.joint_velocity, self._highest_speed),
            Fault.OVERTORQUE: _any_above(state.joint_torque, self._highest_torque),
            Fault.BUS_LOW: state.bus_voltage < self._settings.bus_low * self._voltage,
            Fault.BUS_HIGH: state.bus_voltage > self._settings.bus_high * self._voltage,
            Fault.FALL: trunk_tilt(state) > self._settings.fall_tilt,
            Fault.COLLAPSE: carried and self._extension(state.joint_position) < self._lowest_extension,
            Fault.TUMBLE: max(map(abs, state.angular_velocity.tolist())) > self._settings.tumble_rate,
        }
        found = [fault for fault, holds in conditions.items() if self._timers[fault].update(holds, time)]
        if state.status & RobotStatus.DRIVE_FAULT:
            found.append(Fault.DRIVE_FAULT)
        return found

    def _beyond_limits(self, state: RobotState) -> bool:
        angles = state.joint_position.tolist()
        return any(
            angle < low or angle > high for angle, (low, high) in zip(angles, self._bounds, strict=True)
        )

    def _extension(self, position: np.ndarray) -> float:
        """Vertical reach of the longest leg, trunk level [m]; from abduction, hip and knee angles."""
        abad, hip, knee = np.asarray(position)[self._legs].T
        thigh, shank = self._links
        return float(((thigh * np.cos(hip) + shank * np.cos(hip + knee)) * np.cos(abad)).max())


def _any_above(values: np.ndarray, limits: list[float]) -> bool:
    """Whether a magnitude is above its limit; both one number a joint."""
    return any(abs(value) > limit for value, limit in zip(values.tolist(), limits, strict=True))
