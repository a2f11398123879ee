"""Faults thrown at a controller whose robot runs faster than 6 m/s, over Unitree's messages.

``Rig.step`` asserts of *every* command that leaves the controller that it is finite, within the limits and
inside the motors' envelope. Each case here adds: the fault is noticed under its name, the reaction of
``Fault`` shows in a command within the stated time, and a brake ends in a stand, not in a fall.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from sprintlab.deployment.guard import Fault, Reaction
from sprintlab.deployment.messages import JointCommand, JointMode, RobotState, RobotStatus
from sprintlab.deployment.operators.base import OperatorCommand, Request

TOLERANCE = 1e-9
NAN = float("nan")


class Stimulus:
    """A fault at work on a rig: what passes one of its hooks is changed.

    Attributes:
        steps: how often something has passed.
        kept: what a change remembers from one time to the next.
        begins: whether the fault's condition holds in this step; a change says so where it is not at once.
        present: whether it has held.
    """

    def __init__(self, rig: Any, hook: str, change: Callable[[Stimulus, Any], Any]) -> None:
        self.rig, self.steps, self.kept, self.begins, self.present = rig, 0, [], True, False
        *path, name = hook.split(".")
        owner = functools.reduce(getattr, path, rig)
        self.before = getattr(owner, name)

        def changed(value: Any = None, *_: Any) -> Any:
            self.steps += 1
            try:
                return change(self, value)
            finally:
                self.present = self.present or self.begins

        setattr(owner, name, changed)


def states_become(make: Callable[[list[RobotState], list[RobotState]], list[RobotState]]) -> Any:
    """Deliver what ``make`` makes of the present states and of all since the fault began."""

    def change(stimulus: Stimulus, states: list[RobotState]) -> list[RobotState]:
        stimulus.kept.extend(states)
        return make(states, stimulus.kept)

    return "on_states", change


def each(change: Callable[[RobotState], RobotState], *, times: int = 10**6) -> Any:
    """Change every state, or the first few."""
    return states_become(
        lambda states, past: states if len(past) > times else [change(state) for state in states]
    )


def with_number(field: str, index: int | None, value: float) -> Callable[[RobotState], RobotState]:
    """Another number in a field of a state; ``index`` where the field is a vector."""

    def change(state: RobotState) -> RobotState:
        old = getattr(state, field)
        if index is None:
            return replace(state, **{field: value})
        return replace(state, **{field: np.where(np.arange(len(old)) == index, value, old)})

    return change


def number(field: str, index: int | None, value: float, **times: int) -> Any:
    return each(with_number(field, index, value), **times)


def tilted(state: RobotState) -> RobotState:
    half = math.radians(75.0) / 2.0
    return replace(state, quaternion=np.array([math.cos(half), math.sin(half), 0.0, 0.0]))


def silence(milliseconds: int) -> Any:
    """No state arrives for a while."""
    return states_become(lambda states, past: [] if len(past) <= milliseconds else states)


def drift(index: slice | int, goal: Any, holds: Callable[[np.ndarray], bool]) -> Any:
    """Joint positions drift to ``goal`` at 60 rad/s: slower than a fault that plausibility would drop."""

    def change(stimulus: Stimulus, states: list[RobotState]) -> list[RobotState]:
        position = states[0].joint_position.copy()
        [start] = stimulus.kept = stimulus.kept or [position[index].copy()]
        moved = start + np.sign(goal - start) * np.minimum(np.abs(goal - start), 0.06 * stimulus.steps)
        position[index] = moved + 1e-6 * stimulus.steps  # no real encoder stands still to the last bit
        stimulus.begins = holds(position)
        return [replace(states[0], joint_position=position)]

    return "on_states", change


FOLDED, STANDING = np.tile([0.0, 1.25, -2.42], 4), np.tile([0.0, 0.7, -1.2], 4)


def extension(position: np.ndarray) -> float:
    abad, hip, knee = position.reshape(4, 3).T
    return float(((0.31 * np.cos(hip) + 0.32 * np.cos(hip + knee)) * np.cos(abad)).max())


def stuck_encoder(stimulus: Stimulus, states: list[RobotState]) -> list[RobotState]:
    """A hip encoder stops while the hip moves."""
    [state] = states
    stimulus.begins = bool(stimulus.kept) or abs(state.joint_velocity[1]) > 8.0
    if not stimulus.begins:
        return states
    [held] = stimulus.kept = stimulus.kept or [state.joint_position[1]]
    moving = with_number("joint_velocity", 1, 8.0)(state)
    return [with_number("joint_position", 1, held)(moving)]


def taken_over(stimulus: Stimulus, own: JointCommand) -> None:
    """A robot that checks nothing obeys another controller; it drops what the controller sends."""
    simulated = stimulus.rig.simulated
    push = np.where(np.arange(12) == 2, 30.0, 0.0)  # N m at a knee
    simulated._command = replace(own, feedforward_torque=push, session=own.session ^ 1)
    simulated._expired, simulated._command_time = False, simulated.time


def commands_lost(stimulus: Stimulus, states: list[RobotState], *, told: bool) -> list[RobotState]:
    """No command reaches the robot, whose watchdog tells of it or not."""
    stimulus.rig.on_command = lambda command: None
    stimulus.begins = not told or bool(states[0].status & RobotStatus.WATCHDOG_EXPIRED)
    return states if told else [replace(state, status=0) for state in states]


def stall(stimulus: Stimulus, _: Any) -> int:
    """The controller's process gets no processor for 45 ms; the onset is its return."""
    stimulus.begins = stimulus.steps > 3
    return 45 if stimulus.steps == 3 else 1


def late_policy(stimulus: Stimulus, _: Any) -> int:
    """Every policy step is kept waiting for 8 ms."""
    return 9 if stimulus.rig.controller._next_policy - stimulus.rig.now == 1_000_000 else 1


def source_becomes(make: Callable[[OperatorCommand], OperatorCommand | None], *, times: int = 10**6) -> Any:
    """Change what the source says, always or for its next few readings."""

    def change(stimulus: Stimulus, view: Any) -> OperatorCommand | None:
        command = stimulus.before(view)
        return command if stimulus.steps > times else make(command)

    return "source.read", change


def wish(*values: float) -> Callable[[OperatorCommand], OperatorCommand]:
    return lambda command: command._replace(velocity=np.array(values))


def broken(stimulus: Stimulus, _: Any) -> Any:
    raise OSError("no such device")


def bad_fix(stimulus: Stimulus, fix: Any) -> Any:
    """The receiver is nowhere from its next fix on."""
    stimulus.begins = fix is not None
    return fix and replace(fix, position=np.array([1e308, NAN, 0.0]))


def knock_over(stimulus: Stimulus, states: list[RobotState]) -> list[RobotState]:
    """A blow that really throws the robot over; the onset is a true rate no gait has."""
    plant = stimulus.rig.simulated.plant
    plant.data.xfrc_applied[plant.model.body("trunk").id, 3] = 400.0  # N m of roll
    stimulus.begins = np.abs(states[0].angular_velocity).max() > 15.0
    return states


def keeping(*fields: str) -> Any:
    """Fields of all states are those of the first."""
    return states_become(
        lambda new, past: [replace(new[0], **{field: getattr(past[0], field) for field in fields})]
    )


INERTIAL = ("quaternion", "angular_velocity")
DROPPED = {
    "duplicated state": (Fault.STATE_DUPLICATE, states_become(lambda new, past: new * 2)),
    "old state": (Fault.STATE_OUT_OF_ORDER, states_become(lambda new, past: [*new, past[0]][: len(past)])),
    "NaN joint position": (Fault.STATE_NOT_FINITE, number("joint_position", 4, NAN, times=5)),
    "encoder glitch": (Fault.STATE_IMPLAUSIBLE, number("joint_position", 1, 2.6, times=5)),
    "20 ms without a state": (Fault.STATE_LOST, silence(20)),
    "absurd position fix": (Fault.FIX_INVALID, ("on_fix", bad_fix)),
    "NaN velocity command": (Fault.SOURCE_INVALID, source_becomes(wish(NAN, 0.0, 0.0), times=5)),
}
STOPPED = {
    "states end": (Fault.STATE_STALE, silence(10**6)),
    "content frozen": (Fault.STATE_FROZEN, keeping("joint_position", "joint_velocity", *INERTIAL)),
    "encoder stuck": (Fault.ENCODER_STUCK, ("on_states", stuck_encoder)),
    "inertial unit stuck": (Fault.INERTIAL_STUCK, keeping(*INERTIAL)),
    "joint beyond its stop": (Fault.JOINT_LIMIT, drift(0, 1.2, lambda position: position[0] > 1.0)),
    "joint too fast": (Fault.OVERSPEED, number("joint_velocity", 8, -60.0)),
    "drive gives too much": (Fault.OVERTORQUE, number("joint_torque", 7, 250.0)),
    "bus voltage too high": (Fault.BUS_HIGH, number("bus_voltage", None, 80.0)),
    "trunk tilted": (Fault.FALL, each(tilted)),
    "knocked over": (Fault.TUMBLE, ("on_states", knock_over)),
    "legs folded": (
        Fault.COLLAPSE,
        drift(slice(None), FOLDED, lambda position: extension(position) < 0.5 * extension(STANDING)),
    ),
    "drive reports a fault": (Fault.DRIVE_FAULT, number("status", None, int(RobotStatus.DRIVE_FAULT))),
    "commands lost, watchdog trips": (
        Fault.WATCHDOG_EXPIRED,
        ("on_states", functools.partial(commands_lost, told=True)),
    ),
    "commands lost, silent robot": (
        Fault.COMMANDS_UNANSWERED,
        ("on_states", functools.partial(commands_lost, told=False)),
    ),
    "another's commands": (Fault.COMMANDS_FOREIGN, ("on_command", taken_over)),
    "policy gives NaN": (
        Fault.POLICY_INVALID,
        ("controller._runtime.step", lambda stimulus, seen: np.full(12, np.nan)),
    ),
    "policy crashes": (Fault.POLICY_INVALID, ("controller._runtime.step", broken)),
    "loop stalls": (Fault.LOOP_STALLED, ("pause", stall)),
}
BRAKED = {
    "source silent": (Fault.SOURCE_LOST, source_becomes(lambda command: None)),
    "source raises": (Fault.SOURCE_LOST, ("source.read", broken)),
    "bus voltage too low": (Fault.BUS_LOW, number("bus_voltage", None, 33.0, times=400)),
    "policy always late": (Fault.POLICY_LATE, ("pause", late_policy)),
}
NOT_IN_UNITREES_MESSAGES = {"commands lost, silent robot", "another's commands"}
"""They have no sessions and answers; what is there instead: ``test_unitree_ends.py``."""


@pytest.fixture
def running_on_bus(request: pytest.FixtureRequest, name: str) -> Any:
    """The gallop, continued over Unitree's messages where they can say what a robot does."""
    direct = name in NOT_IN_UNITREES_MESSAGES
    return request.getfixturevalue("running" if direct else "running_on_unitree")


def test_the_matrix_leaves_no_fault_of_a_run_out():
    for reaction, table in ((Reaction.DROP, DROPPED), (Reaction.STOP, STOPPED), (Reaction.BRAKE, BRAKED)):
        known = {fault for fault in Fault if fault.reaction is reaction}
        not_at_speed = {Fault.STAND_FAILED, Fault.BRAKE_FAILED}  # see test_modes
        assert {fault for fault, _ in table.values()} == known - not_at_speed


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
    fault, change = DROPPED[name]
    before = running.controller.fault_counts[fault]
    stimulus = Stimulus(running, *change)
    delay = onset_and_reaction(running, stimulus, lambda tick: fault.value in tick.faults, 0.3)
    allowed = 0.021 if name == "20 ms without a state" else fault.within
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
    fault, change = STOPPED[name]
    stimulus = Stimulus(running, *change)
    delay = onset_and_reaction(running, stimulus, lambda tick: tick.command.mode == JointMode.DAMPING, 1.5)
    assert delay <= fault.within + TOLERANCE
    assert running.controller.stop_reason == fault.value
    running.run(0.1)
    assert running.controller.mode.value == "stop"  # and it stays there, whatever the source says
    assert {tick.command.mode for tick in running.ticks[-100:]} == {JointMode.DAMPING}


def test_a_robot_no_longer_heard_of_is_damped_in_full(running, robot):
    """Although its last state tells of joints so fast that less damping is all that their motors give."""
    fast = np.tile([0.0, 45.0, -45.0], 4)
    Stimulus(running, *each(lambda state: replace(state, joint_velocity=fast)))
    state = running.step().state
    assert (running.controller._commands.guard.damping(state).damping < robot.damping).any()
    Stimulus(running, *silence(10**6))
    running.run(0.2)
    np.testing.assert_array_equal(running.ticks[-1].command.damping, robot.damping)


@pytest.mark.parametrize("name", BRAKED)
def test_a_lesser_fault_brakes_in_time_and_ends_in_a_stand(running_on_bus, name):
    running = running_on_bus
    fault, change = BRAKED[name]
    stimulus = Stimulus(running, *change)
    delay = onset_and_reaction(running, stimulus, lambda tick: running.controller.braking, 1.5)
    assert delay <= fault.within + TOLERANCE and running.controller.fault_counts[fault] > 0
    commanded = running.ticks[-1].velocity[0]
    tick = running.run(0.2)
    assert running.controller.braking and tick.mode == "run" and tick.velocity[0] < commanded - 0.5
    running.run_until(lambda tick: tick.mode == "stand", 7.0)
    place = running.simulated.plant.data.qpos[:2].copy()
    running.run(0.5)
    assert running.controller.mode.value == "stand"  # the source asks to run again, and is not obeyed
    moved = np.abs(running.simulated.plant.data.qpos[:2] - place)
    assert moved.max() < 0.2 and running.simulated.fall_reason == ""  # the policy sways while it stands


def test_the_operators_stop_is_left_only_at_rest_and_only_on_request(running):
    running.source.request = Request.STOP
    tick = running.run_until(lambda tick: tick.command.mode == JointMode.DAMPING, 0.021)
    assert tick.mode == "stop" and running.controller.stop_reason == "operator"
    running.run(0.01)
    running.source.request = Request.PASSIVE
    assert running.run(0.02).mode == "stop"  # in a gallop all joints may be slow for a moment
    running.source.request = Request.RUN
    assert running.run(0.5).mode == "stop"
    running.source.request = Request.PASSIVE
    running.run_until(lambda tick: tick.mode == "passive", 5.0)
    assert running.ticks[-1].command.mode == JointMode.OFF
