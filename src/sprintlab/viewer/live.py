"""A robot that runs while somebody turns the knobs: the evaluation's plant, changed between its steps.

Nothing here knows a browser: a session is advanced by motor steps and hands out what happened.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from sprintlab.commands import heading_command, limit_yaw_rate, self_paced, wrap_angle
from sprintlab.control import POLICY_RATE_HZ, Policy, PolicyRuntime
from sprintlab.core.array_types import FloatArray
from sprintlab.core.checks import check_choice, check_positive, check_range
from sprintlab.core.errors import SimulationError
from sprintlab.motors import MOTOR_MODELS, DriveOutput, MotorModel, PreparedDrive, electrical_power
from sprintlab.plant import MotionRecorder, Plant, PlantOptions, TrialSettings
from sprintlab.robots import RobotDescription, set_friction

HEADING_SLACK = 0.1
"""How far a standing robot may turn away before it is turned back [rad]."""

COMMAND_ACCELERATION = 4.0
"""How fast the command follows the knob [m/s^2]: as in the evaluation's profile."""

LYING_TIME = 1.0
"""A robot that fell is put on its feet again after this time [s]."""


@dataclass(frozen=True, kw_only=True)
class Knobs:
    """What can be changed while the robot runs.

    Raises:
        InvalidValueError: a field is outside its range.
    """

    speed: float = 0.0  # wanted forward speed [m/s], -3 to 20
    yaw_rate: float = 0.0  # wanted turning rate [rad/s], -2 to 2
    self_paced: bool = False  # hold the command near the measured speed
    policy: str = ""
    motor_model: MotorModel = "refined"
    bus_voltage: float = 60.0  # [V]
    friction: float = 0.85  # sliding friction of feet and floor, 0.1 to 2
    payload: float = 0.0  # mass on the trunk [kg], -5 to 20
    slope: float = 0.0  # uphill angle of the ground [rad], -0.35 to 0.35

    def __post_init__(self) -> None:
        check_range("speed", self.speed, -3.0, 20.0, "m/s")
        check_range("yaw_rate", self.yaw_rate, -2.0, 2.0, "rad/s")
        check_choice("motor_model", self.motor_model, MOTOR_MODELS)
        check_positive("bus_voltage", self.bus_voltage, "V")
        check_range("friction", self.friction, 0.1, 2.0)
        check_range("payload", self.payload, -5.0, 20.0, "kg")
        check_range("slope", self.slope, -0.35, 0.35, "rad")


class LivePlant(Plant):
    """The plant of the evaluation, whose motors, ground and load can be changed while it runs."""

    def __init__(self, robot: RobotDescription, options: PlantOptions | None = None) -> None:
        super().__init__(robot, options or PlantOptions(), TrialSettings())
        self._trunk_mass = float(self.model.body_mass[self._trunk])

    def change_surroundings(self, friction: float, payload: float, slope: float) -> None:
        """Set friction, payload [kg] and uphill slope [rad]; the slope turns gravity, the ground stays."""
        set_friction(self.model, friction)
        self.pads.friction = friction
        self.turn_gravity(slope)
        mass = self._trunk_mass + payload
        if self.model.body_mass[self._trunk] != mass:
            self.model.body_mass[self._trunk] = mass
            mujoco.mj_setConst(self.model, mujoco.MjData(self.model))

    def push(self, forward: float, left: float) -> None:
        """Hit the robot: an impulse [N s] in the heading frame, shared by all its parts."""
        heading = self.base_state().heading
        cosine, sine = math.cos(heading), math.sin(heading)
        impulse = np.array((cosine * forward - sine * left, sine * forward + cosine * left))
        self.data.qvel[:2] += impulse / float(self.model.body_mass.sum())

    def stand_up(self) -> None:
        """Put the robot on its feet where it started."""
        self.fall_reason = ""
        self._place(TrialSettings())


@dataclass(frozen=True, kw_only=True)
class Snapshot:
    """What the robot does now."""

    time: float  # simulated time since the start of the session [s]
    speed: float  # forward speed in the heading frame [m/s]
    command: tuple[float, ...]  # what the policy is given: forward, left [m/s], yaw rate [rad/s]
    bus_power: float  # electrical power of all motors, mean over the last advance [W]
    joint_speed: FloatArray  # (n, joints) joint side [rad/s], samples of the last advance, oldest first
    motor_torque: FloatArray  # (n, joints) motor side [N m], same samples
    distance: float  # distance along x since the robot stood up [m]
    falls: int  # how often it fell
    fall_reason: str  # why it lies on the ground; empty while it runs


@dataclass
class _Samples(MotionRecorder):
    """Motor samples since the last snapshot; the plant's recorder."""

    joints: NDArray[np.int64]
    speed: list[FloatArray] = field(default_factory=list)
    torque: list[FloatArray] = field(default_factory=list)
    direct_current: list[FloatArray] = field(default_factory=list)

    def sample(self, data: mujoco.MjData, drive: DriveOutput, targets: FloatArray) -> None:
        self.speed.append(data.qvel[self.joints])
        self.torque.append(np.asarray(drive.motor_torque))
        self.direct_current.append(np.broadcast_to(drive.direct_current, self.joints.shape))

    def take(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Joint speed, motor torque and direct current as ``(n, joints)`` arrays; starts anew."""
        kept = self.speed, self.torque, self.direct_current
        speed, torque, direct = (np.array(values).reshape(-1, len(self.joints)) for values in kept)
        for values in kept:
            values.clear()
        return speed, torque, direct


class Session:
    """One robot, the policies that can drive it, and the knobs.

    ``Knobs.policy`` chooses from the names of the policies; the first is the one to start with.

    Raises:
        InvalidValueError: there is no policy.
        ContractMismatchError: a policy was made for another robot.
    """

    def __init__(
        self, robot: RobotDescription, policies: Mapping[str, Policy], options: PlantOptions | None = None
    ) -> None:
        check_positive("number of policies", len(policies))
        self.robot = robot
        self.plant = LivePlant(robot, options)
        self._runtimes = {name: PolicyRuntime(policy, robot) for name, policy in policies.items()}
        self.knobs = Knobs(policy=next(iter(policies)), bus_voltage=float(robot.bus_voltage))
        self._samples = _Samples(self.plant.joint_addresses[1])
        self._steps_per_action = round(self.plant.options.motor_rate / POLICY_RATE_HZ)
        self._steps, self._falls, self._fallen_steps, self._earlier = 0, 0, 0, 0.0
        self._start_run()

    @property
    def policy_names(self) -> tuple[str, ...]:
        """Names that ``Knobs.policy`` may have."""
        return tuple(self._runtimes)

    def turn(self, **changes: Any) -> None:
        """Change knobs by their names; they act from the next motor or policy step on.

        Raises:
            InvalidValueError: a value is outside its range, or there is no such policy.
        """
        knobs = replace(self.knobs, **changes)
        check_choice("policy", knobs.policy, self.policy_names)
        if (knobs.motor_model, knobs.bus_voltage) != (self.knobs.motor_model, self.knobs.bus_voltage):
            law = knobs.bus_voltage, knobs.motor_model
            self.plant.use_drive(PreparedDrive(self.robot.motors, self.robot.gear, *law))
        self.plant.change_surroundings(knobs.friction, knobs.payload, knobs.slope)
        if knobs.policy != self.knobs.policy:
            self._runtimes[knobs.policy].reset()
        self.knobs = knobs

    def push(self, forward: float = 0.0, left: float = 0.0) -> None:
        """Hit the robot with an impulse [N s]."""
        self.plant.push(forward, left)

    def reset(self) -> None:
        """Put the robot on its feet at the start, command at zero; the knobs stay as they are."""
        self._earlier += self.plant.time
        self.plant.stand_up()
        self._start_run()

    def advance(self, motor_steps: int) -> Snapshot:
        """Let some motor steps pass; a robot that fell stands up again after ``LYING_TIME``."""
        for _ in range(motor_steps):
            try:
                self._motor_step()
            except SimulationError:
                self._falls += 1
                self.reset()
        return self._snapshot()

    def _start_run(self) -> None:
        self._steps, self._fallen_steps = 0, 0
        self._asked, self._heading = 0.0, 0.0
        self.command = np.zeros(3)
        self._runtimes[self.knobs.policy].reset()

    def _motor_step(self) -> None:
        if self._steps % self._steps_per_action == 0:
            self.command = self._next_command()
            targets = self._runtimes[self.knobs.policy].step(self.plant.measurement(), self.command)
            self._targets = np.asarray(targets, dtype=float)
        self._steps += 1
        if self._fallen_steps == 0:
            if not self.plant.advance(self._targets, 1, self._samples):
                self._falls, self._fallen_steps = self._falls + 1, 1
            return
        # It lies, motors off, until it is time to stand up.
        self.plant.drive_joints(np.zeros_like(self._targets), self._targets, self._samples)
        self._fallen_steps += 1
        if self._fallen_steps > LYING_TIME * self.plant.options.motor_rate:
            self.reset()

    def _next_command(self) -> FloatArray:
        """The knobs as a command: the speed rises and falls at 4 m/s^2, the heading follows the turns."""
        knobs, base = self.knobs, self.plant.base_state()
        step = COMMAND_ACCELERATION / POLICY_RATE_HZ
        self._asked += min(max(knobs.speed - self._asked, -step), step)
        speed = float(self_paced(self._asked, base.forward_speed)) if knobs.self_paced else self._asked
        turn = float(limit_yaw_rate(np.asarray(knobs.yaw_rate), np.asarray(speed), knobs.friction))
        self._heading = float(wrap_angle(np.asarray(self._heading + turn / POLICY_RATE_HZ)))
        error = float(wrap_angle(np.asarray(base.heading - self._heading)))
        if speed == 0.0 and turn == 0.0 and abs(error) < HEADING_SLACK:
            return np.zeros(3)  # a robot that is to stand is left in peace
        yaw_rate = turn + float(heading_command(error, 0.0, speed))
        return np.array([speed, 0.0, float(limit_yaw_rate(np.asarray(yaw_rate), np.asarray(speed), 0.7))])

    def _snapshot(self) -> Snapshot:
        speed, torque, direct = self._samples.take()
        motor_speed = speed * self.robot.gear.ratio
        power = electrical_power(self.robot.motors, torque, motor_speed, direct).sum(axis=1)
        base = self.plant.base_state()
        return Snapshot(
            time=self._earlier + self.plant.time,
            speed=base.forward_speed,
            command=tuple(self.command.tolist()),
            bus_power=float(power.mean()) if len(power) else 0.0,
            joint_speed=speed,
            motor_torque=torque,
            distance=base.distance,
            falls=self._falls,
            fall_reason=self.plant.fall_reason if self._fallen_steps else "",
        )
