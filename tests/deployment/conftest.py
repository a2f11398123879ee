"""A real controller on a simulated robot, in simulated time, and a way to start again from a gallop."""

from __future__ import annotations

import copy
import os
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import mujoco
import numpy as np
import pytest
from msgspec.structs import replace

from sprintlab.commands import heading_command
from sprintlab.control import Policy, load_policy, shipped_policy
from sprintlab.deployment.controller import Controller, modes, motion
from sprintlab.deployment.messages import (
    ControlTick,
    JointCommand,
    JointMode,
    PositionFix,
    RobotState,
)
from sprintlab.deployment.operators.base import CommandSource, OperatorCommand, Request, SourceView
from sprintlab.deployment.simulator import SimulatedRobot, SimulatorOptions
from sprintlab.deployment.transports import unitree_ends
from sprintlab.deployment.transports.ends import COMMAND, STATE, Carrier
from sprintlab.deployment.transports.unitree_ends import UnitreeControllerEnd, UnitreeRobotEnd
from sprintlab.motors import torque_limits
from sprintlab.plant import PlantOptions
from sprintlab.robots import RobotDescription, load_robot

MILLISECOND = 1_000_000
COARSE = {"timestep": 0.0005, "contact_time_constant": 0.001}
"""Options of a plant: steps as long as those of the motors, which act as often as ever."""


def hurry(change: Callable[[object, str, object], None]) -> None:
    """Stand up and sink in four fifths of their times; harder, and a policy falls on coarse steps.

    A robot that never comes to rest is waited for twice as long as one at rest is watched.
    """
    change(modes, "_CALM_PATIENCE", 1.0)
    for name in ("TUCK_TIME", "RISE_TIME", "SINK_TIME"):
        change(motion, name, 0.8 * getattr(motion, name))


class StraightSource(CommandSource):
    """Stand up, run straight at 8 m/s and go on until told otherwise."""

    speed = 8.0
    request: Request | None = None

    def read(self, view: SourceView) -> OperatorCommand | None:
        usual = {"passive": Request.STAND, "stand": Request.RUN}.get(view.mode, Request.NONE)
        offset = 0.0 if view.track is None else view.track.offset
        velocity = np.array([self.speed, 0.0, float(heading_command(view.heading, offset, self.speed))])
        return OperatorCommand(velocity, usual if self.request is None else self.request)


class Sent(NamedTuple):
    """A command that left a controller, the last state that it had accepted, and what was known of that."""

    command: JointCommand
    state: RobotState | None
    fresh: bool  # the robot was heard of lately; the torque of a damper is not known where not
    age: float  # of the state when the command acts [s]


def check_safe(sent: Sequence[Sent], robot: RobotDescription) -> None:
    """What must hold for every command that leaves a controller, whatever has happened before."""
    fields = ("target_position", "feedforward_torque", "stiffness", "damping")
    parts = np.array([[getattr(item.command, name) for name in fields] for item in sent])
    mode = np.array([item.command.mode for item in sent])
    known = np.array([item.state is not None for item in sent])
    gains = np.array((robot.stiffness, robot.damping))
    assert np.isfinite(parts).all() and ((parts[:, 2:] >= 0.0) & (parts[:, 2:] <= gains + 1e-9)).all()
    assert not parts[mode == JointMode.OFF].any() and not parts[mode == JointMode.DAMPING, :3].any()
    assert known[mode == JointMode.SERVO].all()
    servo, parts, sent = mode[known, None] == JointMode.SERVO, parts[known], [x for x in sent if x.state]
    if not sent:
        return
    (target, feedforward, stiffness, damping), (lower, upper) = parts.swapaxes(0, 1), robot.position_limits.T
    position = np.array([item.state.joint_position for item in sent])
    velocity = np.array([item.state.joint_velocity for item in sent])
    torque = stiffness * (target - position) - damping * velocity + feedforward
    assert (~servo | ((target >= lower) & (target <= upper))).all()
    assert (torque[servo & (position >= upper)] <= 1e-9).all()  # never further into a stop
    assert (torque[servo & (position <= lower)] >= -1e-9).all()
    ratio = np.asarray(robot.gear.ratio)
    voltage = np.array([[min(item.state.bus_voltage, 1.25 * robot.bus_voltage)] for item in sent])
    age = np.array([[item.age] for item in sent])
    reach = age * np.asarray(robot.motors.peak_torque) / np.asarray(robot.motors.rotor_inertia)
    limits = torque_limits(robot.motors, velocity * ratio + np.linspace(-reach, reach, 3), voltage)
    least, greatest = (ratio * limits[0]).min(axis=0), (ratio * limits[1]).max(axis=0)
    # A damper may be weaker than the back-EMF, never stronger; of a silent robot its torque is not known.
    least, greatest = (
        np.where(servo, least, np.minimum(least, 0.0)),
        np.where(servo, greatest, np.maximum(greatest, 0.0)),
    )
    torque = np.where(servo | np.array([[item.fresh] for item in sent]), torque, 0.0)
    assert ((torque >= least - 1e-6) & (torque <= greatest + 1e-6)).all()


@dataclass
class Rig:
    """Controller and simulated robot, stepped together.

    Each hook may change what passes: the states that arrive, the command on its way (None: lost), the
    milliseconds until the next step, the position fix.
    """

    robot: RobotDescription
    simulated: SimulatedRobot
    controller: Controller
    source: Any
    now: int = 1_000_000_000
    on_states: Callable[[list[RobotState]], list[RobotState]] = lambda states: states
    on_command: Callable[[JointCommand], JointCommand | None] = lambda command: command
    on_fix: Callable[[PositionFix | None], PositionFix | None] = lambda fix: fix
    pause: Callable[[], int] = lambda: 1
    ticks: list[ControlTick] = field(default_factory=list)
    bus: tuple[Any, Any] | None = None
    heard: tuple[RobotState | None, float] = (None, 0.0)
    sent: dict[int, int] = field(default_factory=dict)

    @property
    def speed(self) -> float:
        """Speed of the trunk along x [m/s]."""
        return float(self.simulated.plant.data.qvel[0])

    def step(self) -> ControlTick:
        """One step of the controller, then of the robot until the controller's next one."""
        return self._steps(1, lambda tick: False)

    def _step(self) -> tuple[ControlTick, Sent]:
        states = self.on_states([self.simulated.state(self.now)])
        if self.bus is not None:
            for state in states:
                self.bus[1].publish(state)
            states = list(iter(self.bus[0].receive, None))
        tick = self.controller.step(self.now, states, self.on_fix(self.simulated.fix(self.now)))
        if self.heard[0] is not tick.state:
            self.heard = tick.state, tick.time
        sent = Sent(tick.command, tick.state, tick.time - self.heard[1] < 0.0285, self.age(tick.state))
        self.sent[tick.command.sequence] = self.now
        assert np.isfinite(tick.velocity).all()
        command = self.on_command(tick.command)
        if command is not None:
            self.to_robot(command)
        pause = self.pause()
        for _ in range(pause):
            self.simulated.step()
        self.now += pause * MILLISECOND
        self.ticks.append(tick)
        return tick, sent

    def to_robot(self, command: JointCommand) -> None:
        """A command on its way; what the robot's end drops does not reach the robot."""
        arrived = [command]
        if self.bus is not None:
            self.bus[0].send(command)
            arrived = list(iter(self.bus[1].receive_command, None))
        for each in arrived:
            self.simulated.accept(each)

    def age(self, state: RobotState | None) -> float:
        """How old a state is when the answer to it acts [s], from the command that it names."""
        left = None if state is None else self.sent.get(state.command_sequence)
        return 0.0 if left is None else 1e-9 * (self.now - left) - 0.001

    def run(self, seconds: float) -> ControlTick:
        """Step for some time; the last tick."""
        return self._steps(max(1, round(seconds * 1000)), lambda tick: False)

    def run_until(self, condition: Callable[[ControlTick], bool], seconds: float) -> ControlTick:
        """Step until a tick satisfies the condition; an assertion fails when none does in time."""
        tick = self._steps(round(seconds * 1000), condition)
        assert condition(tick), (
            f"not within {seconds} s; mode {tick.mode}, faults {self.controller.fault_counts}"
        )
        return tick

    def _steps(self, most: int, enough: Callable[[ControlTick], bool]) -> ControlTick:
        """Step until it is enough; all commands are checked together, which takes a third of the time."""
        sent = []
        for _ in range(most):
            tick, command = self._step()
            sent.append(command)
            if enough(tick):
                break
        check_safe(sent, self.robot)
        return tick


@dataclass
class Snapshot:
    """A rig at one moment, to be continued many times; one at a time, since the robot is the same."""

    rig: Rig
    policy: Policy
    physics: np.ndarray
    attributes: dict[str, Any]
    motor_steps: int
    controller: Controller
    source: Any
    now: int
    sent: dict[int, int]

    @classmethod
    def take(cls, rig: Rig, policy: Policy) -> Snapshot:
        plant = rig.simulated.plant
        physics = np.empty(mujoco.mj_stateSize(plant.model, mujoco.mjtState.mjSTATE_INTEGRATION))
        mujoco.mj_getState(plant.model, plant.data, physics, mujoco.mjtState.mjSTATE_INTEGRATION)
        attributes = {key: value for key, value in vars(rig.simulated).items() if key != "plant"}
        controller, source = _copy_controller(rig.controller, rig.source, policy)
        motor_steps = plant._motor_steps
        return cls(rig, policy, physics, attributes, motor_steps, controller, source, rig.now, dict(rig.sent))

    def restore(self) -> Rig:
        simulated, plant = self.rig.simulated, self.rig.simulated.plant
        vars(simulated).update(copy.deepcopy({k: v for k, v in self.attributes.items() if k[1:] != "robot"}))
        mujoco.mj_setState(plant.model, plant.data, self.physics, mujoco.mjtState.mjSTATE_INTEGRATION)
        plant._motor_steps, plant.fall_reason = self.motor_steps, ""
        controller, source = _copy_controller(self.controller, self.source, self.policy)
        return Rig(self.rig.robot, simulated, controller, source, self.now, sent=dict(self.sent))


def _copy_controller(controller: Controller, source: Any, policy: Policy) -> tuple[Controller, Any]:
    new_source = copy.deepcopy(source)
    return copy.deepcopy(controller, {id(policy): policy, id(source): new_source}), new_source


@pytest.fixture
def hurried(monkeypatch: pytest.MonkeyPatch) -> None:
    """Standing up and sinking in four fifths of their times, where a test is not about how that is done."""
    hurry(monkeypatch.setattr)


@pytest.fixture(scope="session")
def sprint_policy() -> Policy:
    return load_policy(shipped_policy())


@pytest.fixture(scope="session")
def make_rig(sprint_policy: Policy) -> Callable[..., Rig]:
    """A rig whose robot lies on the ground: the one that the policy was made for; ``sprint`` by default.

    The physics take coarse steps: runs on those of a user are in ``test_through_the_bus.py``.
    """

    def make(source: Any | None = None, policy: Policy | None = None) -> Rig:
        source, policy = source or StraightSource(), policy or sprint_policy
        robot = load_robot(policy.contract.robot_name)
        simulated = SimulatedRobot(robot, SimulatorOptions(plant=PlantOptions(**COARSE)))
        return Rig(robot, simulated, Controller(policy, robot, source), source)

    return make


@pytest.fixture(scope="session")
def lying_robot(make_rig: Callable[..., Rig], sprint_policy: Policy) -> Snapshot:
    """A robot on the ground before its first command."""
    return Snapshot.take(make_rig(), sprint_policy)


@pytest.fixture
def lie_down_with(lying_robot: Snapshot) -> Callable[[Any], Rig]:
    """The lying robot with a new controller for a source."""

    def make(source: Any) -> Rig:
        rig = lying_robot.restore()
        rig.source, rig.controller = source, Controller(lying_robot.policy, rig.robot, source)
        return rig

    return make


@pytest.fixture(scope="session")
def gallop(make_rig: Callable[..., Rig], sprint_policy: Policy) -> Snapshot:
    """Running faster than 6 m/s, speed still rising."""
    rig = make_rig()
    with pytest.MonkeyPatch.context() as patch:
        hurry(patch.setattr)
        rig.run_until(lambda tick: rig.speed > 6.5, 8.0)
    return Snapshot.take(rig, sprint_policy)


@pytest.fixture
def running(gallop: Snapshot) -> Rig:
    """The gallop, continued."""
    rig = gallop.restore()
    assert rig.speed > 6.0 and rig.controller.mode.value == "run"
    return rig


class Loopback(Carrier):
    """Carries bytes through queues of this process; ``others' command`` holds those of another controller."""

    peer_left = False
    heard = True

    def __init__(self, wires: dict[str, deque[bytes]], reads: str) -> None:
        self.wires, self._reads = wires, reads

    def take(self, channel: str) -> bytes | None:
        waiting = self.wires.get(channel if channel == self._reads else f"others' {channel}")
        return waiting.popleft() if waiting else None

    def put(self, channel: str, content: bytes) -> None:
        self.wires.setdefault(channel, deque()).append(content)

    @property
    def is_heard(self) -> bool:
        return self.heard

    def close(self) -> None:
        """Nothing to let go of."""


def loopback(session: int) -> tuple[UnitreeControllerEnd, UnitreeRobotEnd]:
    """Both ends of a bus that speaks Unitree's messages without a DDS library."""
    wires: dict[str, deque[bytes]] = {}
    return UnitreeControllerEnd(Loopback(wires, STATE), session), UnitreeRobotEnd(Loopback(wires, COMMAND))


@pytest.fixture
def unitree_loopback() -> Callable[[int], tuple[UnitreeControllerEnd, UnitreeRobotEnd]]:
    return loopback


@pytest.fixture
def running_on_unitree(running: Rig, monkeypatch: pytest.MonkeyPatch) -> Rig:
    """The gallop, continued over 1000 of Unitree's messages a second, as if they had carried it so far."""
    monkeypatch.setattr(unitree_ends, "_SLACK", unitree_ends.PERIOD)
    interface, endpoint = loopback(running.controller.session)
    running.bus = interface, endpoint
    state, numbers = running.controller.state, interface._numbers
    milliseconds = state.timestamp // MILLISECOND
    numbers._last, numbers._time, numbers._number = milliseconds % 2**32, milliseconds, state.sequence
    interface._sent.extend(sorted(running.sent.items())[-interface._sent.maxlen :])
    interface._answered = running.controller._answer
    command = running.simulated._command
    running.simulated._command = replace(command, session=endpoint.carrier.author, sequence=0)
    return running


@pytest.fixture
def bus_name(request: pytest.FixtureRequest) -> str:
    """A name that no other test uses."""
    return f"test-{os.getpid()}-{abs(hash(request.node.nodeid)) % 10**8}"
