"""The robot's own electronics around the plant: command checks, watchdog, sensors."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field

import mujoco
import numpy as np

from sprintlab.core.checks import check_choice, check_range
from sprintlab.core.errors import InvalidValueError, SimulationError
from sprintlab.deployment.messages import (
    WATCHDOG_TIMEOUT,
    FloatArray,
    JointCommand,
    JointMode,
    MessageError,
    PositionFix,
    RobotState,
    RobotStatus,
    check_command,
)
from sprintlab.motors import DriveOutput
from sprintlab.plant import Plant, PlantOptions, TrialSettings
from sprintlab.robots import RobotDescription

TYPICAL_NOISE = {
    "joint_position": 0.001,  # [rad]
    "joint_velocity": 0.05,  # [rad/s]
    "joint_torque": 0.5,  # [N m]
    "angular_velocity": 0.01,  # [rad/s]
    "orientation": 0.005,  # [rad] about each axis
    "track_position": 0.01,  # [m] of position fixes
    "track_velocity": 0.03,  # [m/s] of position fixes
}
"""Standard deviations of white noise, drawn anew for every message.

Assumed, of the order of 14-bit encoders, an industrial MEMS inertial unit and an RTK receiver."""
_SETTLING = 2.0  # [s] that a robot takes to sink to the ground
_UPRIGHT = 0.8  # share of the standing height
_SUDDEN = 0.3  # [s] from upright to the ground; a free fall takes 0.25 s, lying down half a second
_MOVING = 0.5  # [m/s]


@dataclass(frozen=True, kw_only=True)
class SimulatorOptions:
    """The robot behind the bus."""

    plant: PlantOptions = field(default_factory=PlantOptions)  # physics and motors
    trial: TrialSettings = field(default_factory=TrialSettings)  # friction, payload, initial joint noise
    noise: float = 0.0  # sensor noise as a multiple of ``TYPICAL_NOISE``
    # ``"lying"``: sunk to the ground with damped joints; ``"standing"``: in the default pose
    start: str = "lying"
    fix_rate: float = 10.0  # position fixes a second [Hz], 0 for none
    # without a command for this long, the robot damps its joints by itself [s]
    watchdog_timeout: float = WATCHDOG_TIMEOUT
    seed: int = 0  # decides noise and links

    def __post_init__(self) -> None:
        check_choice("simulator.start", self.start, ("lying", "standing"))
        if self.plant.ground.slope:
            allowed = "the sensors of the robot behind the bus know level ground only"
            raise InvalidValueError("simulator.plant.ground.slope", self.plant.ground.slope, allowed)
        check_range("simulator.noise", self.noise, 0.0, 100.0)
        check_range("simulator.fix_rate", self.fix_rate, 0.0, 1000.0, "Hz")
        check_range("simulator.watchdog_timeout", self.watchdog_timeout, 0.001, 10.0, "s")
        check_range("simulator.seed", self.seed, 0, 2**32 - 1)


class SimulatedRobot:
    """A plant that behaves on the bus as ``sprintlab.deployment.messages`` asks of a robot."""

    def __init__(self, robot: RobotDescription, options: SimulatorOptions) -> None:
        self.plant = Plant(robot, options.plant, options.trial)
        self.accepted = 0  # commands acted on
        self.dropped: Counter[str] = Counter()  # commands that were not acted on, by the reason
        self.watchdog_trips = 0  # times the watchdog took over from a controller that drove the joints
        self.fall_reason = ""  # why the robot fell first; empty before that
        self._robot, self._options = robot, options
        self._random = np.random.default_rng(options.seed)
        self._period = 1.0 / options.plant.motor_rate
        self._steps = self._states = self._fixes = 0
        self._command: JointCommand | None = None
        self._command_time = 0.0
        self._expired = True
        self._upright_time = -math.inf
        self._drive: DriveOutput | None = None
        if options.start == "lying":
            self._settle()

    @property
    def time(self) -> float:
        """Simulated time since the start [s]."""
        return self._steps * self._period

    def accept(self, command: JointCommand) -> bool:
        """Act on a command from now on, unless the robot must not; returns whether it does."""
        reason = self._refusal(command)
        if reason:
            self.dropped[reason] += 1
            return False
        self.accepted += 1
        self._command, self._command_time, self._expired = command, self.time, False
        return True

    def _refusal(self, command: JointCommand) -> str:
        """Why the robot must not act on a command; empty where it may."""
        try:
            check_command(command, len(self._robot.joint_names))
        except MessageError as error:
            return str(error)
        last = self._command
        if last is not None and command.session != last.session:
            if not self._expired:
                return "it is of another controller than the one that drives"
        elif last is not None and command.sequence <= last.sequence:
            return "its number is not above that of the last accepted command"
        if self._expired and command.mode == JointMode.SERVO:
            return "the watchdog has expired: only a damping or off command is taken first"
        return ""

    def step(self) -> None:
        """Live for one motor step."""
        silence = self.time - self._command_time
        if not self._expired and silence > self._options.watchdog_timeout + 0.5 * self._period:
            self._expired = True
            self.watchdog_trips += self._command is not None and self._command.mode != JointMode.OFF
        wanted, targets = self._wanted(*self.plant.joint_state())
        self._drive = self.plant.drive_joints(wanted, targets)
        self._steps += 1
        self._notice_falls()

    def state(self, timestamp: int) -> RobotState:
        """What the sensors say now; ``timestamp`` in nanoseconds.

        Raises:
            SimulationError: the simulated state is no longer finite.
        """
        data, noisy = self.plant.data, self._noisy
        position, velocity = self.plant.joint_state()
        if not math.isfinite(float(data.qpos.sum() + data.qvel.sum())):
            raise SimulationError(f"the simulated state is no longer finite at {self.time:.2f} s")
        self._states += 1
        torque = np.zeros(len(self._robot.joint_names)) if self._drive is None else self._drive.torque
        return RobotState(
            sequence=self._states,
            timestamp=timestamp,
            joint_position=noisy(position, "joint_position"),
            joint_velocity=noisy(velocity, "joint_velocity"),
            joint_torque=noisy(torque, "joint_torque"),
            quaternion=self._turned(data.qpos[3:7].copy()),
            angular_velocity=noisy(data.qvel[3:6], "angular_velocity"),
            bus_voltage=self._bus_voltage,
            command_sequence=0 if self._command is None else self._command.sequence,
            status=int(RobotStatus.WATCHDOG_EXPIRED if self._expired else RobotStatus.READY),
            session=0 if self._command is None else self._command.session,
        )

    def fix(self, timestamp: int) -> PositionFix | None:
        """A position fix if one is due at this step; ``timestamp`` in nanoseconds."""
        due = self._options.fix_rate * self.time
        if self._options.fix_rate == 0.0 or due + 1e-6 < self._fixes:
            return None
        self._fixes = math.floor(due + 1e-6) + 1
        return PositionFix(
            sequence=self._fixes,
            timestamp=timestamp,
            position=self._noisy(self.plant.data.qpos[:3], "track_position"),
            velocity=self._noisy(self.plant.data.qvel[:3], "track_velocity"),
        )

    @property
    def _bus_voltage(self) -> float:
        """Voltage at the drives [V]: what the battery leaves, where there is one."""
        supply = self.plant.supply
        if supply is None:
            return self._options.plant.bus_voltage or self._robot.bus_voltage
        return supply.bus_voltage

    def _wanted(self, position: FloatArray, velocity: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Joint torques asked of the motors [N m] and, for the record, joint targets [rad]."""
        command = self._command
        if self._expired or command is None:
            return -self._robot.damping * velocity, position
        if command.mode == JointMode.OFF:
            return np.zeros_like(velocity), position
        damping = -command.damping * velocity
        if command.mode == JointMode.DAMPING:
            return damping, position
        spring = command.stiffness * (command.target_position - position)
        return spring + damping + command.feedforward_torque, command.target_position

    def _notice_falls(self) -> None:
        """A fall is a tilt beyond 60 degrees, or trunk or knee on the ground at speed or suddenly.

        Lying down slowly, or with damped joints from a stand, is not a fall.
        """
        data = self.plant.data
        if data.qpos[2] > _UPRIGHT * self._robot.standing_height:
            self._upright_time = self.time
        if self.fall_reason or not self.plant.fall_reason:
            return
        serving = self._command is not None and self._command.mode == JointMode.SERVO and not self._expired
        sudden = serving and self.time - self._upright_time < _SUDDEN
        moving = self._upright_time >= 0.0 and math.hypot(*data.qvel[:2].tolist()) > _MOVING
        if self.plant.fall_reason == "tilt" or sudden or moving:
            self.fall_reason = self.plant.fall_reason

    def _settle(self) -> None:
        """Sink to the ground with damped joints, and call the place where that ends the origin."""
        data = self.plant.data
        for _ in range(round(_SETTLING / self._period)):
            wanted = -self._robot.damping * self.plant.joint_state()[1]
            self.plant.drive_joints(wanted, self._robot.default_pose)
        data.qpos[:2] = 0.0
        data.qvel[:] = 0.0
        data.time = 0.0

    def _noisy(self, value: FloatArray, name: str) -> FloatArray:
        """A copy of a sensor's values with noise."""
        deviation = self._options.noise * TYPICAL_NOISE[name]
        if deviation == 0.0:
            return np.array(value, dtype=float)
        return value + deviation * self._random.standard_normal(value.shape)

    def _turned(self, quaternion: FloatArray) -> FloatArray:
        """The orientation, turned by a small random rotation in the body frame."""
        if self._options.noise == 0.0:
            return quaternion
        small = np.append(1.0, 0.5 * self._noisy(np.zeros(3), "orientation"))
        turned = np.empty(4)
        mujoco.mju_mulQuat(turned, quaternion, small)
        return turned / np.linalg.norm(turned)
