"""Faults thrown at a controller whose robot runs faster than 6 m/s, over every bus.

``Rig.step`` asserts of *every* command that leaves the controller that it is finite, within the limits and
inside the motors' envelope. Each case here adds: the fault is noticed under its name, the reaction of
``RESPONSES`` shows in a command within the stated time, and a brake ends in a stand, not in a fall.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np
import pytest

from sprintlab.core.errors import InvalidValueError
from sprintlab.deployment.bus.unitree_ends import UnitreeControllerEnd
from sprintlab.deployment.interface import (
    JointCommand,
    JointMode,
    OperatorCommand,
    Request,
    RobotState,
    RobotStatus,
    decode,
    encode,
)
from sprintlab.deployment.safety import RESPONSES, Fault, Reaction

TOLERANCE = 1e-9


def with_entry(vector: np.ndarray, index: int, value: float) -> np.ndarray:
    changed = vector.copy()
    changed[index] = value
    return changed


class Stimulus:
    """A fault at work on a rig; ``present`` tells whether its condition holds already."""

    def __init__(self, rig: Any) -> None:
        self.rig = rig
        self.steps = 0
        self.present = False


def on_every_state(change: Callable[[RobotState], RobotState], *, times: int | None = None) -> Any:
    """Change every state, or the first few."""

    def install(rig: Any) -> Stimulus:
        stimulus = Stimulus(rig)

        def hook(states: list[RobotState]) -> list[RobotState]:
            stimulus.steps += 1
            stimulus.present = True
            if times is not None and stimulus.steps > times:
                return states
            return [change(state) for state in states]

        rig.on_states = hook
        return stimulus

    return install


def set_field(field: str, index: int | None, value: float) -> Callable[[RobotState], RobotState]:
    def change(state: RobotState) -> RobotState:
        old = getattr(state, field)
        return msgspec.structs.replace(
            state, **{field: value if index is None else with_entry(old, index, value)}
        )

    return change


def set_flag(flag: RobotStatus) -> Callable[[RobotState], RobotState]:
    return lambda state: msgspec.structs.replace(state, status=state.status | int(flag))


def tilted(degrees: float) -> Callable[[RobotState], RobotState]:
    half = math.radians(degrees) / 2.0
    quaternion = np.array([math.cos(half), math.sin(half), 0.0, 0.0])
    return lambda state: msgspec.structs.replace(state, quaternion=quaternion)


def states_become(make: Callable[[list[RobotState], list[RobotState]], list[RobotState]]) -> Any:
    """Deliver what ``make`` makes of the present states and of all before."""

    def install(rig: Any) -> Stimulus:
        stimulus, past = Stimulus(rig), []

        def hook(states: list[RobotState]) -> list[RobotState]:
            stimulus.present = True
            past.extend(states)
            return make(states, past)

        rig.on_states = hook
        return stimulus

    return install


def silence(milliseconds: int | None) -> Any:
    """No state arrives, for a while or for ever."""
    return states_become(
        lambda states, past: [] if milliseconds is None or len(past) <= milliseconds else states
    )


def ramp(
    field: str, index: slice | int, goal: float | np.ndarray, holds: Callable[[RobotState], bool]
) -> Any:
    """A measured value drifts to ``goal`` at 60 rad/s: slower than a fault that plausibility would drop."""

    def install(rig: Any) -> Stimulus:
        stimulus = Stimulus(rig)
        start: list[np.ndarray] = []

        def hook(states: list[RobotState]) -> list[RobotState]:
            stimulus.steps += 1
            vector = getattr(states[0], field).copy()
            start[:] = start or [vector[index].copy()]
            way = goal - start[0]
            moved = start[0] + np.sign(way) * np.minimum(np.abs(way), 0.06 * stimulus.steps)
            vector[index] = moved + 1e-6 * stimulus.steps  # no real encoder stands still to the last bit
            state = msgspec.structs.replace(states[0], **{field: vector})
            stimulus.present = stimulus.present or holds(state)
            return [state]

        rig.on_states = hook
        return stimulus

    return install


def extension(position: np.ndarray) -> float:
    abad, hip, knee = position.reshape(4, 3).T
    return float(((0.31 * np.cos(hip) + 0.32 * np.cos(hip + knee)) * np.cos(abad)).max())


def frozen(states: list[RobotState], past: list[RobotState]) -> list[RobotState]:
    """New sequence and timestamp, old content."""
    state = states[0]
    return [msgspec.structs.replace(past[0], sequence=state.sequence, timestamp=state.timestamp)]


def stuck_encoder(rig: Any) -> Stimulus:
    """A hip encoder stops while the hip moves."""
    stimulus = Stimulus(rig)
    held: list[float] = []

    def hook(states: list[RobotState]) -> list[RobotState]:
        state = states[0]
        moving = abs(state.joint_velocity[1]) > 8.0
        if not held and not moving:
            return states
        held[:] = held or [state.joint_position[1]]
        stimulus.present = True
        position = with_entry(state.joint_position, 1, held[0])
        velocity = with_entry(state.joint_velocity, 1, 8.0)
        return [msgspec.structs.replace(state, joint_position=position, joint_velocity=velocity)]

    rig.on_states = hook
    return stimulus


def taken_over(command: Callable[[Any, int], dict[str, Any]]) -> Any:
    """A robot that checks nothing obeys another controller; it drops what the controller sends."""

    def install(rig: Any) -> Stimulus:
        stimulus, simulated = Stimulus(rig), rig.simulated
        simulated._expired = False

        def drop(own: Any) -> None:
            stimulus.steps += 1
            stimulus.present = True
            push = np.zeros(12)
            push[2] = 30.0  # N m at a knee
            foreign = msgspec.structs.replace(own, feedforward_torque=push, **command(own, stimulus.steps))
            simulated._command, simulated._command_time = foreign, simulated.time

        rig.on_command = drop
        return stimulus

    return install


def on_the_wire(direction: str, change: Callable[[bytes], bytes], *, onset: int = 1) -> Any:
    """Change the bytes of every message in one direction; ``onset``: how many of them make the fault."""

    def install(rig: Any) -> Stimulus:
        stimulus = Stimulus(rig)

        def hook(content: bytes) -> bytes:
            stimulus.steps += 1
            stimulus.present = stimulus.steps >= onset
            return change(content)

        setattr(rig, {"states": "on_bytes", "commands": "on_command_bytes"}[direction], hook)
        return stimulus

    return install


def one_bit(content: bytes) -> bytes:
    return content[:100] + bytes([content[100] ^ 1]) + content[101:]


def of_another_session(content: bytes) -> bytes:
    command = decode(JointCommand, content)
    return encode(msgspec.structs.replace(command, session=command.session ^ 1))


def rebooted(states: list[RobotState], past: list[RobotState]) -> list[RobotState]:
    return [msgspec.structs.replace(states[0], sequence=len(past), timestamp=len(past) * 10**6)]


def lose_commands(rig: Any) -> Stimulus:
    """No command reaches the robot, whose watchdog says nothing of it."""
    stimulus = Stimulus(rig)
    rig.on_command = lambda command: None
    rig.on_states = lambda states: [msgspec.structs.replace(states[0], status=0)]
    stimulus.present = True
    return stimulus


def lose_commands_with_watchdog(rig: Any) -> Stimulus:
    """No command reaches the robot; its watchdog trips, and that is the onset."""
    stimulus = Stimulus(rig)
    rig.on_command = lambda command: None

    def hook(states: list[RobotState]) -> list[RobotState]:
        stimulus.present = bool(states[0].status & RobotStatus.WATCHDOG_EXPIRED)
        return states

    rig.on_states = hook
    return stimulus


class BrokenRuntime:
    """Stands in for the policy."""

    def __init__(self, result: Any) -> None:
        self.result = result

    def step(self, measurement: Any, command: Any) -> Any:
        if isinstance(self.result, Exception):
            raise self.result
        return self.result


def break_policy(result: Any) -> Any:
    """The policy gives ``result``; the onset is its next step."""

    def install(rig: Any) -> Stimulus:
        stimulus = Stimulus(rig)
        runtime = BrokenRuntime(result)
        inner = runtime.step

        def step(measurement: Any, command: Any) -> Any:
            stimulus.present = True
            return inner(measurement, command)

        runtime.step = step  # type: ignore[method-assign]
        rig.controller._runtime = runtime
        return stimulus

    return install


def stall(milliseconds: int) -> Any:
    """The controller's process gets no processor for a while; the onset is its return."""

    def install(rig: Any) -> Stimulus:
        stimulus = Stimulus(rig)

        def pause() -> int:
            stimulus.steps += 1
            return milliseconds if stimulus.steps == 3 else 1

        def hook(states: list[RobotState]) -> list[RobotState]:
            stimulus.present = stimulus.steps >= 3
            return states

        rig.pause, rig.on_states = pause, hook
        return stimulus

    return install


def late_policy(rig: Any) -> Stimulus:
    """Every policy step is kept waiting for 8 ms."""
    stimulus = Stimulus(rig)

    def pause() -> int:
        stimulus.present = True
        return 9 if rig.controller._next_policy - rig.now == 1_000_000 else 1

    rig.pause = pause
    return stimulus


def source_becomes(
    make: Callable[[OperatorCommand], OperatorCommand | None], *, times: int | None = None
) -> Any:
    """Change what the source says, always or for its next few readings."""

    def install(rig: Any) -> Stimulus:
        stimulus, read = Stimulus(rig), rig.source.read

        def changed(view: Any) -> OperatorCommand | None:
            stimulus.steps += 1
            stimulus.present = True
            command = read(view)
            return command if times is not None and stimulus.steps > times else make(command)

        rig.source.read = changed
        return stimulus

    return install


def velocity(*values: float) -> Callable[[OperatorCommand], OperatorCommand]:
    return lambda command: msgspec.structs.replace(command, velocity=np.array(values))


def broken_device(command: OperatorCommand) -> OperatorCommand:
    raise OSError("no such device")


def bad_fix(**fields: np.ndarray) -> Any:
    """The receiver reports something else from its next fix on."""

    def install(rig: Any) -> Stimulus:
        stimulus = Stimulus(rig)

        def hook(fix: Any) -> Any:
            if fix is None:
                return None
            stimulus.present = True
            return msgspec.structs.replace(fix, **fields)

        rig.on_fix = hook
        return stimulus

    return install


def stuck_inertial_unit(states: list[RobotState], past: list[RobotState]) -> list[RobotState]:
    """Orientation and gyro stay what they were; the encoders go on."""
    first = past[0]
    return [
        msgspec.structs.replace(
            states[0], quaternion=first.quaternion, angular_velocity=first.angular_velocity
        )
    ]


def knock_over(rig: Any) -> Stimulus:
    """A blow that really throws the robot over; the onset is a true rate no gait has."""
    stimulus = Stimulus(rig)
    plant = rig.simulated.plant
    plant.data.xfrc_applied[plant.model.body("trunk").id, 3] = 400.0  # N m of roll

    def hook(states: list[RobotState]) -> list[RobotState]:
        stimulus.present = stimulus.present or np.abs(states[0].angular_velocity).max() > 15.0
        return states

    rig.on_states = hook
    return stimulus


NAN, INF = float("nan"), float("inf")

DROPPED = {
    "duplicated state": (Fault.STATE_DUPLICATE, states_become(lambda new, past: new * 2)),
    "old state": (Fault.STATE_OUT_OF_ORDER, states_become(lambda new, past: [*new, past[0]][: len(past)])),
    "swapped pair": (
        Fault.STATE_OUT_OF_ORDER,
        states_become(lambda new, past: [] if len(past) % 2 else [past[-1], past[-2]]),
    ),
    "clock of the robot runs back": (
        Fault.STATE_OUT_OF_ORDER,
        on_every_state(
            lambda state: msgspec.structs.replace(state, timestamp=state.timestamp - 10**9), times=5
        ),
    ),
    "NaN joint position": (
        Fault.STATE_NOT_FINITE,
        on_every_state(set_field("joint_position", 4, NAN), times=5),
    ),
    "infinite joint velocity": (
        Fault.STATE_NOT_FINITE,
        on_every_state(set_field("joint_velocity", 0, INF), times=5),
    ),
    "NaN torque": (Fault.STATE_NOT_FINITE, on_every_state(set_field("joint_torque", 11, NAN), times=5)),
    "NaN orientation": (Fault.STATE_NOT_FINITE, on_every_state(set_field("quaternion", 2, NAN), times=5)),
    "NaN gyro": (Fault.STATE_NOT_FINITE, on_every_state(set_field("angular_velocity", 1, NAN), times=5)),
    "NaN bus voltage": (Fault.STATE_NOT_FINITE, on_every_state(set_field("bus_voltage", None, NAN), times=5)),
    "encoder glitch": (Fault.STATE_IMPLAUSIBLE, on_every_state(set_field("joint_position", 1, 2.6), times=5)),
    "encoder far outside": (
        Fault.STATE_IMPLAUSIBLE,
        on_every_state(set_field("joint_position", 2, -40.0), times=5),
    ),
    "velocity spike": (Fault.STATE_IMPLAUSIBLE, on_every_state(set_field("joint_velocity", 5, 1e4), times=5)),
    "gyro spike": (Fault.STATE_IMPLAUSIBLE, on_every_state(set_field("angular_velocity", 0, 500.0), times=5)),
    "orientation not a rotation": (
        Fault.STATE_IMPLAUSIBLE,
        on_every_state(set_field("quaternion", 0, 0.0), times=5),
    ),
    "negative bus voltage": (
        Fault.STATE_IMPLAUSIBLE,
        on_every_state(set_field("bus_voltage", None, -1.0), times=5),
    ),
    "20 ms without a state": (Fault.STATE_LOST, silence(20)),
    "NaN position fix": (Fault.FIX_INVALID, bad_fix(position=np.full(3, NAN))),
    "position fix of 1e308 m": (
        Fault.FIX_INVALID,
        bad_fix(position=np.array([1e308, -1e308, 0.0]), velocity=np.array([1e308, -1e308, 0.0])),
    ),
    "NaN velocity command": (Fault.SOURCE_INVALID, source_becomes(velocity(NAN, 0.0, 0.0), times=5)),
    "infinite yaw rate": (Fault.SOURCE_INVALID, source_becomes(velocity(8.0, 0.0, INF), times=5)),
    "velocity command of two numbers": (Fault.SOURCE_INVALID, source_becomes(velocity(8.0, 0.0), times=5)),
    "old velocity command": (
        Fault.SOURCE_INVALID,
        source_becomes(lambda command: msgspec.structs.replace(command, sequence=1), times=5),
    ),
}

STOPPED = {
    "states end": (Fault.STATE_STALE, silence(None)),
    "nothing but NaN": (Fault.STATE_STALE, on_every_state(set_field("joint_position", 3, NAN))),
    "robot reboots": (Fault.STATE_STALE, states_become(rebooted)),
    "content frozen": (Fault.STATE_FROZEN, states_become(frozen)),
    "encoder stuck": (Fault.ENCODER_STUCK, stuck_encoder),
    "inertial unit stuck": (Fault.INERTIAL_STUCK, states_become(stuck_inertial_unit)),
    "joint beyond its stop": (
        Fault.JOINT_LIMIT,
        ramp("joint_position", 0, 1.2, lambda state: state.joint_position[0] > 1.0),
    ),
    "joint too fast": (Fault.OVERSPEED, on_every_state(set_field("joint_velocity", 8, -60.0))),
    "drive gives too much": (Fault.OVERTORQUE, on_every_state(set_field("joint_torque", 7, 250.0))),
    "bus voltage too high": (Fault.BUS_HIGH, on_every_state(set_field("bus_voltage", None, 80.0))),
    "trunk tilted": (Fault.FALL, on_every_state(tilted(75.0))),
    "trunk upside down": (Fault.FALL, on_every_state(tilted(180.0))),
    "knocked over": (Fault.TUMBLE, knock_over),
    "legs folded": (
        Fault.COLLAPSE,
        ramp(
            "joint_position",
            slice(None),
            np.tile([0.0, 1.25, -2.42], 4),
            lambda state: extension(state.joint_position) < 0.5 * extension(np.tile([0.0, 0.7, -1.2], 4)),
        ),
    ),
    "trunk spins": (Fault.TUMBLE, on_every_state(set_field("angular_velocity", 2, 30.0))),
    "drive reports a fault": (Fault.DRIVE_FAULT, on_every_state(set_flag(RobotStatus.DRIVE_FAULT))),
    "watchdog reported": (Fault.WATCHDOG_EXPIRED, on_every_state(set_flag(RobotStatus.WATCHDOG_EXPIRED))),
    "commands lost, watchdog trips": (Fault.WATCHDOG_EXPIRED, lose_commands_with_watchdog),
    "commands lost, silent robot": (Fault.COMMANDS_UNANSWERED, lose_commands),
    "another's commands, of another session": (
        Fault.COMMANDS_FOREIGN,
        taken_over(lambda own, step: {"session": own.session ^ 1}),
    ),
    "answer to a command never sent": (
        Fault.COMMANDS_FOREIGN,
        on_every_state(set_field("command_sequence", None, 2**64 - 1)),
    ),
    "answer falls": (
        Fault.COMMANDS_FOREIGN,
        on_every_state(set_field("command_sequence", None, 1)),
    ),
    "robot forgets whom it obeys": (Fault.COMMANDS_FOREIGN, on_every_state(set_field("session", None, 0))),
    "every state damaged": (Fault.STATE_STALE, on_the_wire("states", one_bit)),
    "states empty": (Fault.STATE_STALE, on_the_wire("states", lambda content: bytes(len(content)))),
    "every command damaged": (Fault.WATCHDOG_EXPIRED, on_the_wire("commands", one_bit, onset=50)),
    "commands lose their session": (
        Fault.WATCHDOG_EXPIRED,
        on_the_wire("commands", of_another_session, onset=50),
    ),
    "policy gives NaN": (Fault.POLICY_INVALID, break_policy(np.full(12, np.nan))),
    "policy gives 1e308": (Fault.POLICY_INVALID, break_policy(np.full(12, 1e308))),
    "policy gives infinity": (Fault.POLICY_INVALID, break_policy(np.full(12, -np.inf))),
    "policy refuses": (Fault.POLICY_INVALID, break_policy(InvalidValueError("command", 0, "nothing"))),
    "policy crashes": (Fault.POLICY_INVALID, break_policy(RuntimeError("out of memory"))),
    "policy gives eleven joints": (Fault.POLICY_INVALID, break_policy(np.zeros(11))),
    "loop stalls": (Fault.LOOP_STALLED, stall(45)),
}

BRAKED = {
    "source silent": (Fault.SOURCE_LOST, source_becomes(lambda command: None)),
    "source repeats itself": (
        Fault.SOURCE_LOST,
        source_becomes(lambda command: msgspec.structs.replace(command, sequence=10**6)),
    ),
    "source raises": (Fault.SOURCE_LOST, source_becomes(broken_device)),
    "source gives nothing but NaN": (Fault.SOURCE_LOST, source_becomes(velocity(NAN, NAN, NAN))),
    "bus voltage too low": (Fault.BUS_LOW, on_every_state(set_field("bus_voltage", None, 33.0), times=400)),
    "policy always late": (Fault.POLICY_LATE, late_policy),
}


NOT_IN_UNITREES_MESSAGES = {
    "commands lost, silent robot",
    "another's commands, of another session",
    "answer to a command never sent",
    "answer falls",
    "robot forgets whom it obeys",
    "commands lose their session",
}
"""They have no numbers, sessions and answers; what is there instead: ``test_unitree_bus.py``."""


def test_the_matrix_leaves_no_fault_of_a_run_out():
    tried = {fault for table in (DROPPED, STOPPED, BRAKED) for fault, _ in table.values()}
    assert set(Fault) - tried == {Fault.STAND_FAILED, Fault.BRAKE_FAILED}  # not met at speed: see test_modes


def assert_reaction_fits(table: dict[str, Any], reaction: Reaction) -> None:
    assert {RESPONSES[fault].reaction for fault, _ in table.values()} == {reaction}


def onset_and_reaction(rig: Any, stimulus: Stimulus, shows: Callable[[Any], bool], seconds: float) -> float:
    """Time from the first step with the fault present to the first whose command shows the reaction [s]."""
    onset = None
    for _ in range(round(seconds * 1000)):
        time = rig.now * 1e-9
        tick = rig.step()
        if onset is None and stimulus.present:
            onset = time
        if shows(tick):
            assert onset is not None, f"{rig.controller.stop_reason} came before the fault"
            return time - onset
    raise AssertionError(f"no reaction; faults {rig.controller.fault_counts}")


@pytest.mark.parametrize("name", DROPPED)
def test_a_bad_message_is_dropped_and_the_run_goes_on(running_on_bus, name):
    running = running_on_bus
    assert_reaction_fits(DROPPED, Reaction.DROP)
    fault, install = DROPPED[name]
    before = running.controller.fault_counts[fault]
    stimulus = install(running)
    delay = onset_and_reaction(running, stimulus, lambda tick: fault.value in tick.faults, 0.3)
    allowed = 0.021 if name == "20 ms without a state" else RESPONSES[fault].within
    assert delay <= allowed + TOLERANCE
    running.run(0.08)
    assert running.controller.fault_counts[fault] > before
    assert {tick.mode for tick in running.ticks} == {"run"} and not running.controller.braking
    assert running.speed > 6.0 and running.simulated.fall_reason == ""
    for tick in running.ticks:  # nothing unusable was ever used
        assert np.isfinite(tick.state.joint_position).all() and np.isfinite(tick.targets).all()


@pytest.mark.parametrize("name", STOPPED)
def test_a_grave_fault_damps_the_joints_in_time(running_on_bus, name):
    running = running_on_bus
    if name in NOT_IN_UNITREES_MESSAGES and isinstance(running.bus[0], UnitreeControllerEnd):
        pytest.skip("Unitree's messages cannot say this")
    assert_reaction_fits(STOPPED, Reaction.STOP)
    fault, install = STOPPED[name]
    stimulus = install(running)
    delay = onset_and_reaction(running, stimulus, lambda tick: tick.command.mode == JointMode.DAMPING, 1.5)
    assert delay <= RESPONSES[fault].within + TOLERANCE
    assert running.controller.stop_reason == fault.value
    running.run(0.1)
    assert running.controller.mode.value == "stop"  # and it stays there, whatever the source says
    assert {tick.command.mode for tick in running.ticks[-100:]} == {JointMode.DAMPING}


def test_a_robot_no_longer_heard_of_is_damped_in_full(running, robot):
    """Although its last state tells of joints so fast that less damping is all that their motors give."""
    fast = np.tile([0.0, 45.0, -45.0], 4)
    on_every_state(lambda state: msgspec.structs.replace(state, joint_velocity=fast))(running)
    state = running.step().state
    assert (running.controller._commands.guard.damping(robot.damping, state).damping < robot.damping).any()
    silence(None)(running)
    running.run(0.2)
    np.testing.assert_array_equal(running.ticks[-1].command.damping, robot.damping)


@pytest.mark.parametrize("name", BRAKED)
def test_a_lesser_fault_brakes_in_time(running_on_bus, name):
    assert_reaction_fits(BRAKED, Reaction.BRAKE)
    braked(running_on_bus, name)
    commanded = running_on_bus.ticks[-1].velocity[0]
    tick = running_on_bus.run(0.2)
    assert running_on_bus.controller.braking and tick.mode == "run"
    assert tick.velocity[0] < commanded - 0.5 and running_on_bus.simulated.fall_reason == ""


@pytest.mark.parametrize("name", {fault: name for name, (fault, _) in reversed(BRAKED.items())}.values())
def test_a_brake_ends_in_a_stand(running, name):
    """One cause of every fault that brakes; it does not depend on the bus that the fault came over."""
    braked(running, name)
    commanded = running.ticks[-1].velocity[0]
    running.run_until(lambda tick: tick.mode == "stand", commanded / 4.0 + 3.0)
    place = running.simulated.plant.data.qpos[:2].copy()
    running.run(0.5)
    assert running.controller.mode.value == "stand"  # the source asks to run again, and is not obeyed
    moved = np.abs(running.simulated.plant.data.qpos[:2] - place)
    assert moved.max() < 0.2 and running.simulated.fall_reason == ""  # the policy sways while it stands


def braked(running: Any, name: str) -> None:
    """Throw a fault that brakes, and go on until it does, in time."""
    fault, install = BRAKED[name]
    stimulus = install(running)
    delay = onset_and_reaction(running, stimulus, lambda tick: running.controller.braking, 1.5)
    assert delay <= RESPONSES[fault].within + TOLERANCE
    assert running.controller.fault_counts[fault] > 0


@pytest.mark.parametrize("wish", [(1e6, 0.0, 0.0), (-50.0, 3.0, 90.0), (0.0, 0.0, -1e9)])
def test_a_wild_wish_reaches_the_policy_tamed(running, wish):
    source_becomes(velocity(*wish))(running)
    previous = running.ticks[-1].velocity if running.ticks else running.controller._velocity
    for _ in range(500):
        tick = running.step()
        if tick.policy_step:
            change = np.abs(tick.velocity - previous)
            assert change[0] <= 6.0 * 0.02 + TOLERANCE and change[2] <= 20.0 * 0.02 + TOLERANCE
            assert -2.0 <= tick.velocity[0] <= 12.0 and tick.velocity[1] == 0.0
            assert abs(tick.velocity[2]) <= 1.0 and abs(tick.velocity[0] * tick.velocity[2]) <= 0.7 * 9.82
            previous = tick.velocity


def test_a_sagging_bus_shrinks_what_is_asked_for(running):
    on_every_state(set_field("bus_voltage", None, 45.0))(running)
    running.run(0.3)  # every command is checked against the smaller envelope in Rig.step
    assert running.controller.mode.value == "run"


def test_commands_of_a_second_controller_move_nothing_and_are_counted(running):
    """Numbered above the controller's commands, at the same rate, with a torque at a knee."""
    push = np.zeros(12)
    push[2] = 30.0

    def both(own):
        other = msgspec.structs.replace(
            own, session=own.session ^ 1, sequence=own.sequence + 10**6, feedforward_torque=push
        )
        assert not running.simulated.accept(other)
        return own

    running.on_command = both
    running.run(0.1)
    assert running.controller.mode.value == "run" and running.speed > 6.0
    assert dict(running.simulated.dropped) == {"it is of another controller than the one that drives": 100}


def test_the_operator_stops_a_run_at_once(running):
    running.source.request = Request.STOP
    tick = running.run_until(lambda tick: tick.command.mode == JointMode.DAMPING, 0.021)
    assert tick.mode == "stop" and running.controller.stop_reason == "operator"


def test_stop_is_left_only_at_rest_and_only_on_request(running):
    running.source.request = Request.STOP
    running.run(0.03)
    running.source.request = Request.PASSIVE
    assert running.run(0.02).mode == "stop"  # in a gallop all joints may be slow for a moment
    running.source.request = Request.RUN
    assert running.run(0.5).mode == "stop"
    running.source.request = Request.PASSIVE
    running.run_until(lambda tick: tick.mode == "passive", 5.0)
    assert running.ticks[-1].command.mode == JointMode.OFF
