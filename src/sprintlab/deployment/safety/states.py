"""Which of the robot's messages may be used: order, age, finiteness, plausibility."""

from __future__ import annotations

import math

import numpy as np

from sprintlab.deployment.interface import RobotState
from sprintlab.deployment.safety.faults import Fault
from sprintlab.deployment.safety.settings import SafetySettings
from sprintlab.deployment.safety.timer import Persistence
from sprintlab.motors import no_load_speed
from sprintlab.robots import RobotDescription

_HIGHEST_GYRO = 60.0  # rad/s: beyond the range of common inertial units
_QUATERNION_TOLERANCE = 0.02
_JUMP_MARGIN = 0.05  # rad: encoder noise
_LONGEST_GAP = 0.05  # s: over a longer gap a jump of position says nothing
_POSITION_SLACK = 0.6  # rad beyond the limits: no stop gives that much
_SPEED_SLACK = 2.0  # times the no-load speed


class StateMonitor:
    """Looks at every state before anybody else does.

    Attributes:
        last: the last accepted state.
    """

    def __init__(self, robot: RobotDescription, settings: SafetySettings) -> None:
        lower, upper = robot.position_limits.T
        self._lower, self._upper = lower - _POSITION_SLACK, upper + _POSITION_SLACK
        speed = np.asarray(no_load_speed(robot.motors, robot.bus_voltage)) / np.asarray(robot.gear.ratio)
        self._highest_speed = _SPEED_SLACK * speed
        # Twelve numbers are compared in half the time that NumPy needs to begin.
        self._bounds = list(zip(self._lower.tolist(), self._upper.tolist(), strict=True))
        self._speeds = np.broadcast_to(self._highest_speed, self._lower.shape).tolist()
        self._highest_voltage = 2.0 * robot.bus_voltage
        self._settings = settings
        self.reset()

    def reset(self) -> None:
        """Start with the next state, whatever its sequence: the robot may have been restarted."""
        self.last: RobotState | None = None
        self._accepted_at: float | None = None
        self._content: bytes = b""
        self._frozen = Persistence(self._settings.frozen_time)
        self._inertial: bytes = b""
        self._inertial_stuck = Persistence(self._settings.frozen_time)
        self._never = self._stuck_since = np.full(len(self._lower), np.inf)

    def age(self, time: float) -> float | None:
        """Time since the last accepted state [s]; None before the first."""
        return None if self._accepted_at is None else time - self._accepted_at

    def accept(self, state: RobotState, time: float) -> list[Fault]:
        """Judge one state in order of arrival; a usable one becomes ``last``.

        Args:
            state: as received.
            time: controller's clock [s].

        Returns:
            What is wrong with it; ``STATE_LOST`` and the stuck sensors do not keep it from being used.
        """
        with np.errstate(all="ignore"):  # absurd numbers overflow, and are refused for it
            refusal = self._refusal(state)
        if refusal is not None:
            return [refusal]
        faults = self._sensor_faults(state, time)
        if self.last is not None and state.sequence > self.last.sequence + 1:
            faults.append(Fault.STATE_LOST)
        self.last, self._accepted_at = state, time
        return faults

    def stale(self, time: float) -> bool:
        """Whether the last accepted state is too old to act on."""
        age = self.age(time)
        return age is not None and age >= self._settings.state_timeout - 1e-9

    def _refusal(self, state: RobotState) -> Fault | None:
        last = self.last
        if state.joint_position.shape != self._lower.shape:
            return Fault.STATE_IMPLAUSIBLE
        if last is not None and state.sequence == last.sequence:
            return Fault.STATE_DUPLICATE
        if last is not None and (state.sequence < last.sequence or state.timestamp <= last.timestamp):
            return Fault.STATE_OUT_OF_ORDER
        numbers = (state.joint_position, state.joint_velocity, state.joint_torque, state.quaternion)
        total = sum(float(np.add.reduce(vector)) for vector in numbers)
        if not math.isfinite(total + float(np.add.reduce(state.angular_velocity)) + state.bus_voltage):
            return Fault.STATE_NOT_FINITE
        return None if self._plausible(state) else Fault.STATE_IMPLAUSIBLE

    def _plausible(self, state: RobotState) -> bool:
        position, velocity = state.joint_position.tolist(), state.joint_velocity.tolist()
        return bool(
            all(low <= angle <= high for (low, high), angle in zip(self._bounds, position, strict=True))
            and all(abs(speed) <= most for speed, most in zip(velocity, self._speeds, strict=True))
            and max(map(abs, state.angular_velocity.tolist())) <= _HIGHEST_GYRO
            and abs(float(state.quaternion @ state.quaternion) - 1.0) <= _QUATERNION_TOLERANCE
            and 0.0 <= state.bus_voltage <= self._highest_voltage
            and self._continuous(state)
        )

    def _continuous(self, state: RobotState) -> bool:
        """No joint moved further than its motor can turn it since the last state."""
        if self.last is None:
            return True
        gap = (state.timestamp - self.last.timestamp) * 1e-9
        if gap > _LONGEST_GAP:
            return True
        moved = np.abs(state.joint_position - self.last.joint_position)
        return bool((moved <= self._highest_speed * gap + _JUMP_MARGIN).all())

    def _sensor_faults(self, state: RobotState, time: float) -> list[Fault]:
        faults: list[Fault] = []
        content = state.joint_position.tobytes() + state.joint_velocity.tobytes()
        inertial = state.quaternion.tobytes() + state.angular_velocity.tobytes()
        moving = max(map(abs, state.joint_velocity.tolist())) > self._settings.stuck_velocity
        same = inertial == self._inertial and moving
        if self._frozen.update(same and content == self._content, time):
            faults.append(Fault.STATE_FROZEN)
        if self._inertial_stuck.update(same and content != self._content, time):
            faults.append(Fault.INERTIAL_STUCK)
        self._content, self._inertial = content, inertial
        if self._stuck(state, time):
            faults.append(Fault.ENCODER_STUCK)
        return faults

    def _stuck(self, state: RobotState, time: float) -> bool:
        """One joint's position stands still to the last bit while its speed says that it moves."""
        if self.last is None:
            return False
        still = state.joint_position == self.last.joint_position
        still &= np.abs(state.joint_velocity) > self._settings.stuck_velocity
        if not np.count_nonzero(still):
            self._stuck_since = self._never
            return False
        self._stuck_since = np.where(still, np.minimum(self._stuck_since, time), np.inf)
        return bool((time - self._stuck_since >= self._settings.frozen_time - 1e-9).any())
