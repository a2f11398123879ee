"""What the robot's states tell: which of them may be used, and whether robot and drives are well.

The thresholds below, and the times of ``Fault``, say when.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from sprintlab.deployment.guard.faults import Fault
from sprintlab.deployment.messages import FloatArray, RobotState, RobotStatus
from sprintlab.motors import no_load_speed
from sprintlab.robots import RobotDescription

# Beyond these no sensor shows anything: such a state is dropped.
_HIGHEST_GYRO = 60.0  # rad/s: beyond the range of common inertial units
_QUATERNION_TOLERANCE = 0.02
_JUMP_MARGIN = 0.05  # rad: encoder noise
_LONGEST_GAP = 0.05  # s: over a longer gap a jump of position says nothing
_POSITION_SLACK = 0.6  # rad beyond the limits: no stop gives that much
_SPEED_SLACK = 2.0  # times the no-load speed
_STUCK_VELOCITY = 2.0  # rad/s of a joint at which an unchanging position is a fault
# Beyond these something is wrong with the robot.
_LIMIT_MARGIN = 0.30  # rad beyond a joint's limits that elastic end stops may give
_OVERSPEED = 1.3  # joint speed over no-load speed
_OVERTORQUE = 1.3  # joint torque over peak torque
_BUS_LOW, _BUS_HIGH = 0.6, 1.25  # bus voltage over nominal
_FALL_TILT = 60.0  # degrees of the trunk
_COLLAPSE_HEIGHT = 0.5  # leg extension over standing extension below which a leg carries nothing
_TUMBLE_RATE = 15.0  # rad/s of the trunk


class Persistence:
    """True once a condition has held for ``duration`` [s]; one sample without it starts anew."""

    def __init__(self, duration: float) -> None:
        self._duration = duration - 1e-9  # times are sums of milliseconds, exact to rounding
        self._since: float | None = None

    def update(self, condition: bool, time: float) -> bool:
        """Take the condition at ``time`` [s]; returns whether it has held long enough."""
        if not condition:
            self._since = None
            return False
        self._since = time if self._since is None else self._since
        return time - self._since >= self._duration


class StateMonitor:
    """Decides which states may be used; ``last`` is the last accepted one."""

    def __init__(self, robot: RobotDescription) -> None:
        self._middle, self._reach = _joint_range(robot, _POSITION_SLACK)
        self._fastest = _SPEED_SLACK * _no_load_joint_speed(robot)
        self._speeds = self._fastest.tolist()
        self._highest_voltage = 2.0 * robot.bus_voltage
        self.reset()

    def reset(self) -> None:
        """Start with the next state, whatever its sequence: the robot may have been restarted."""
        self.last: RobotState | None = None
        self._accepted_at = math.inf

    def accept(self, state: RobotState, time: float) -> list[Fault]:
        """What is wrong with a state that arrived at ``time`` [s]; a usable one becomes ``last``.

        ``STATE_LOST`` does not keep it from being used.
        """
        refusal = self._refusal(state)
        if refusal is not None:
            return [refusal]
        lost = self.last is not None and state.sequence > self.last.sequence + 1
        self.last, self._accepted_at = state, time
        return [Fault.STATE_LOST] if lost else []

    def stale(self, time: float) -> bool:
        """Whether the last accepted state is too old to act on; not before the first one."""
        return time - self._accepted_at >= Fault.STATE_STALE.lasts - 1e-9

    def _refusal(self, state: RobotState) -> Fault | None:
        last, joints = self.last, self._fastest.shape
        vectors = (state.joint_position, state.joint_velocity, state.joint_torque)
        if any(vector.shape != joints for vector in vectors):
            return Fault.STATE_IMPLAUSIBLE  # another robot's
        if last is not None and state.sequence == last.sequence:
            return Fault.STATE_DUPLICATE
        if last is not None and (state.sequence < last.sequence or state.timestamp <= last.timestamp):
            return Fault.STATE_OUT_OF_ORDER
        # A dozen numbers are compared in half the time that NumPy needs to begin.
        position, velocity = state.joint_position.tolist(), state.joint_velocity.tolist()
        gyro, turn = state.angular_velocity.tolist(), state.quaternion.tolist()
        total = sum(position) + sum(velocity) + sum(state.joint_torque.tolist()) + sum(gyro) + sum(turn)
        if not math.isfinite(total + state.bus_voltage):
            return Fault.STATE_NOT_FINITE
        plausible = (
            not _any_above(map(float.__sub__, position, self._middle), self._reach)
            and not _any_above(velocity, self._speeds)
            and max(map(abs, gyro)) <= _HIGHEST_GYRO
            and abs(sum(x * x for x in turn) - 1.0) <= _QUATERNION_TOLERANCE
            and 0.0 <= state.bus_voltage <= self._highest_voltage
            and self._continuous(state)
        )
        return None if plausible else Fault.STATE_IMPLAUSIBLE

    def _continuous(self, state: RobotState) -> bool:
        """No joint moved further than its motor can turn it since the last state."""
        if self.last is None:
            return True
        gap = (state.timestamp - self.last.timestamp) * 1e-9
        moved = np.abs(state.joint_position - self.last.joint_position)
        return gap > _LONGEST_GAP or bool((moved <= self._fastest * gap + _JUMP_MARGIN).all())


class BodyMonitor:
    """Finds the faults that good states tell of: falls, joints, stuck sensors, the bus, the drives."""

    def __init__(self, robot: RobotDescription) -> None:
        self._middle, self._reach = _joint_range(robot, _LIMIT_MARGIN)
        self._fastest = (_OVERSPEED * _no_load_joint_speed(robot)).tolist()
        torque = _OVERTORQUE * np.asarray(robot.motors.peak_torque) * np.asarray(robot.gear.ratio)
        self._strongest = np.broadcast_to(torque, len(self._middle)).tolist()
        self._lowest_bus, self._highest_bus = _BUS_LOW * robot.bus_voltage, _BUS_HIGH * robot.bus_voltage
        self._legs = robot.leg_joints
        self._links = (robot.mechanics.thigh_length, robot.mechanics.shank_length)
        self._lowest_extension = _COLLAPSE_HEIGHT * self._extension(robot.default_pose)
        self.reset()

    def reset(self) -> None:
        """Forget how long anything has lasted."""
        self._timers = {fault: Persistence(fault.lasts) for fault in Fault}
        self._last: RobotState | None = None

    def check(self, state: RobotState, time: float, *, carried: bool) -> list[Fault]:
        """Faults that an accepted state shows at ``time`` [s].

        ``carried``: the legs are meant to carry the trunk, and a collapse is a fault.
        """
        bent = map(float.__sub__, state.joint_position.tolist(), self._middle)
        conditions = {
            **self._stuck(state),
            Fault.JOINT_LIMIT: _any_above(bent, self._reach),
            Fault.OVERSPEED: _any_above(state.joint_velocity.tolist(), self._fastest),
            Fault.OVERTORQUE: _any_above(state.joint_torque.tolist(), self._strongest),
            Fault.BUS_LOW: state.bus_voltage < self._lowest_bus,
            Fault.BUS_HIGH: state.bus_voltage > self._highest_bus,
            Fault.FALL: trunk_tilt(state) > _FALL_TILT,
            Fault.COLLAPSE: carried and self._extension(state.joint_position) < self._lowest_extension,
            Fault.TUMBLE: max(map(abs, state.angular_velocity.tolist())) > _TUMBLE_RATE,
            Fault.DRIVE_FAULT: bool(state.status & RobotStatus.DRIVE_FAULT),
        }
        return [fault for fault, holds in conditions.items() if self._timers[fault].update(holds, time)]

    def _stuck(self, state: RobotState) -> dict[Fault, bool]:
        """Sensors that give the same to the last bit while joints move, as no real one does."""
        last, self._last = self._last or state, state
        moving = (np.abs(state.joint_velocity) > _STUCK_VELOCITY) & (last is not state)
        still = state.joint_position == last.joint_position
        gyro, orientation = state.angular_velocity, state.quaternion
        turns = (gyro != last.angular_velocity).any() or (orientation != last.quaternion).any()
        unmoved = moving.any() and not turns
        return {
            Fault.STATE_FROZEN: bool(unmoved and still.all()),
            Fault.INERTIAL_STUCK: bool(unmoved and not still.all()),
            Fault.ENCODER_STUCK: bool((moving & still).any()),
        }

    def _extension(self, position: FloatArray) -> float:
        """Vertical reach of the longest leg, trunk level [m]; from abduction, hip and knee angles."""
        abad, hip, knee = position[self._legs].T
        thigh, shank = self._links
        return float(((thigh * np.cos(hip) + shank * np.cos(hip + knee)) * np.cos(abad)).max())


def trunk_tilt(state: RobotState) -> float:
    """Angle between the trunk's vertical axis and the world's [degrees]."""
    _, x, y, _ = state.quaternion.tolist()
    return math.degrees(math.acos(min(1.0, max(-1.0, 1.0 - 2.0 * (x * x + y * y)))))


def _no_load_joint_speed(robot: RobotDescription) -> FloatArray:
    """No-load speed of each joint at the nominal bus voltage [rad/s] ``(joints,)``."""
    speed = np.asarray(no_load_speed(robot.motors, robot.bus_voltage)) / np.asarray(robot.gear.ratio)
    return np.broadcast_to(speed, (len(robot.joint_names),)).astype(float)


def _joint_range(robot: RobotDescription, slack: float) -> tuple[list[float], list[float]]:
    """Middle of each joint's range, and how far it may be from it with ``slack`` beyond the limits [rad]."""
    lower, upper = robot.position_limits.T
    return (0.5 * (lower + upper)).tolist(), (0.5 * (upper - lower) + slack).tolist()


def _any_above(values: Iterable[float], limits: Sequence[float]) -> bool:
    """Whether a magnitude is above its limit."""
    return any(abs(value) > limit for value, limit in zip(values, limits, strict=True))
