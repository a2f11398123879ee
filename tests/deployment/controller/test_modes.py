"""The state machine on a simulated robot: every way between the modes, and every way that is refused."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from msgspec.structs import replace

from sprintlab.control import (
    Measurement,
    PolicyRuntime,
    load_policy,
    projected_gravity,
    shipped_policy,
)
from sprintlab.deployment.controller import Controller
from sprintlab.deployment.controller import modes as modes_module
from sprintlab.deployment.controller.modes import Mode, Run
from sprintlab.deployment.guard import Fault
from sprintlab.deployment.guard.monitors import trunk_tilt
from sprintlab.deployment.messages import JointMode, RobotStatus
from sprintlab.deployment.operators.base import OperatorCommand, Request


class Operator:
    """Says what it is told to."""

    request, speed = Request.NONE, 0.0

    def read(self, view):
        return OperatorCommand(np.array([self.speed, 0.0, 0.0]), self.request)


def modes(rig):
    return [mode for mode, _ in itertools.groupby(tick.mode for tick in rig.ticks)]


def until(rig, mode, seconds=6.0):
    return rig.run_until(lambda tick: tick.mode == mode, seconds)


@pytest.fixture
def lying(lie_down_with):
    return lie_down_with(Operator())


@pytest.fixture(scope="module")
def stood(gallop, sprint_policy):
    """The gallop, braked to the stand after it."""
    rig = gallop.restore()
    rig.source.request = Request.STAND
    until(rig, "stand")
    return gallop.take(rig, sprint_policy)


@pytest.fixture
def standing(stood):
    return stood.restore()


@pytest.fixture(scope="module", params=["sprint", "go2-sprint"])
def policy(request):
    """Those of the robot of the paper and of one that can be bought."""
    return load_policy(shipped_policy(request.param))


@pytest.fixture(scope="module")
def whole_life(make_rig, policy):
    """Stand up, run for a second at 2 m/s, come down: once for all tests that look at it."""
    rig = make_rig(Operator(), policy)
    rig.source.request = Request.STAND
    until(rig, "stand")
    rig.source.request, rig.source.speed = Request.RUN, 2.0
    until(rig, "run")
    rig.run(1.2)
    rig.source.request = Request.LIE_DOWN
    until(rig, "passive", 12.0)
    return rig


def test_a_whole_life_goes_through_the_modes_in_order(whole_life):
    ticks = whole_life.ticks
    assert modes(whole_life) == ["passive", "stand-up", "stand", "run", "stand", "lie-down", "passive"]
    assert whole_life.simulated.fall_reason == "" and not whole_life.simulated.dropped
    assert set(whole_life.controller.fault_counts) <= {Fault.STATE_LOST}
    assert (np.diff([tick.command.sequence for tick in ticks]) == 1).all()
    drives = {(tick.mode, tick.command.mode.name.lower()) for tick in ticks}
    served = {(mode, "servo") for mode in ("stand-up", "stand", "run", "lie-down")}
    assert drives == {("passive", "off"), *served, ("lie-down", "damping")}


def test_the_policy_runs_at_50_hz_and_keeps_the_balance_in_the_stand_after_the_run(whole_life):
    steps = [tick for tick in whole_life.ticks if tick.policy_step]
    assert [mode for mode, _ in itertools.groupby(tick.mode for tick in steps)] == ["run", "stand"]
    assert np.diff([tick.time for tick in steps]) == pytest.approx(0.02)
    assert max(tick.velocity[0] for tick in steps) == pytest.approx(2.0)
    assert whole_life.simulated.plant.data.qpos[0] > 1.0


def test_it_lies_down_slowly_and_level_and_damps_only_on_its_belly(whole_life):
    down = [tick for tick in whole_life.ticks if tick.mode == "lie-down"]
    assert max(trunk_tilt(tick.state) for tick in down) < 8.0
    heights = [(tick.time, tick.fix.position[2]) for tick in down if tick.fix is not None]
    times, heights = np.array(heights).T
    assert (np.diff(heights) / np.diff(times) > -0.45).all()  # m/s
    damped_from = next(tick.time for tick in down if tick.command.mode == JointMode.DAMPING)
    robot = whole_life.robot
    assert np.interp(damped_from, times, heights) < robot.mechanics.trunk_half_size[2] + robot.foot_radius


def test_targets_never_jump_but_where_the_policy_takes_over(whole_life):
    before = None
    for tick in whole_life.ticks:
        same = before is not None and tick.mode == before.mode and not tick.policy_step
        if same and tick.mode in ("stand-up", "stand", "lie-down"):
            most = 0.05 if tick.mode == "lie-down" else 0.02
            assert np.abs(tick.targets - before.targets).max() < most
        before = tick


def test_the_run_is_the_very_code_of_the_evaluation(whole_life, policy):
    """Fed with the states of the run, ``PolicyRuntime`` gives the targets that the controller had."""
    runtime = PolicyRuntime(policy, whole_life.robot)
    steps = [tick for tick in whole_life.ticks if tick.policy_step][:80]
    for tick in steps:
        state = tick.state
        gravity = np.asarray(projected_gravity(state.quaternion))
        seen = Measurement(state.angular_velocity, gravity, state.joint_position, state.joint_velocity)
        np.testing.assert_array_equal(runtime.step(seen, tick.velocity), tick.targets)


UNFIT = [
    {"quaternion": np.array([np.cos(0.4), np.sin(0.4), 0.0, 0.0])},
    {"joint_velocity": np.full(12, 3.0)},
    {"status": int(RobotStatus.DRIVE_FAULT)},
    {"command_sequence": 1},
]
"""Tilted, moving, a fault of a drive, answers no more."""


@pytest.mark.parametrize("changes", UNFIT, ids=lambda changes: next(iter(changes)))
def test_an_unfit_robot_is_not_stood_up(lying, changes):
    lying.run(0.2)
    lying.on_states = lambda states: [replace(state, **changes) for state in states]
    lying.run(0.2)
    lying.source.request = Request.STAND
    assert lying.run(0.2).mode == "passive"
    lying.on_states = lambda states: states
    assert lying.run(0.2).mode == "stand-up"  # as soon as it is fit


def test_a_new_controller_is_taken_when_the_old_one_has_been_silent(lying, sprint_policy, robot):
    lying.run(0.5)
    lying.controller = Controller(sprint_policy, robot, lying.source)
    lying.source.request = Request.STAND
    accepted = lying.simulated.accepted
    lying.run(0.049)
    assert lying.simulated.accepted == accepted
    assert lying.controller.mode.value == "passive"
    lying.run(0.1)
    assert lying.controller.mode.value == "stand-up"
    assert lying.simulated.accepted >= accepted + 98


@pytest.mark.usefixtures("hurried")
def test_a_stand_up_that_fails_ends_in_a_stop(lying, monkeypatch):
    """The drives give a fiftieth of the torque that they are asked for."""
    lying.source.request = Request.STAND
    asked = lying.simulated._wanted

    def weakened(position, velocity):
        torque, target = asked(position, velocity)
        return 0.02 * torque, target

    monkeypatch.setattr(lying.simulated, "_wanted", weakened)
    tick = lying.run_until(lambda tick: tick.command.mode == JointMode.DAMPING, 4.0)
    assert Fault.STAND_FAILED.value in tick.faults
    assert lying.controller.stop_reason == "stand-failed"


def restless(speed):
    """States in which one joint turns at ``speed`` [rad/s], whatever it does."""

    def changed(states):
        velocity = states[0].joint_velocity.copy()
        velocity[0] = speed
        return [replace(states[0], joint_velocity=velocity)]

    return changed


@pytest.mark.parametrize(
    ("joint_speed", "estimate", "end"),
    [(7.0, 0.4, Mode.STAND), (7.0, 0.6, Fault.BRAKE_FAILED), (7.0, None, Fault.BRAKE_FAILED),
     (5.0, 0.6, Mode.STAND)],
)  # fmt: skip
def test_braked_means_calm_joints_or_a_robot_that_steps_on_the_spot(lying, joint_speed, estimate, end):
    """Policies that were not trained to stand trot: their joints never rest."""
    run = Run(0.5, lambda: estimate)
    run.brake(0.0)
    [state] = restless(joint_speed)([lying.simulated.state(0)])
    outcomes = [run.advance(state, 0.02 * step, np.zeros(3)) for step in range(300)]
    assert next(outcome for outcome in outcomes if outcome is not None) == end
    assert all(outcome is None for outcome in outcomes[:25]), "half a second of rest is not enough"


@pytest.mark.usefixtures("hurried")
def test_coming_down_overrules_the_source(running):
    running.controller.come_down()
    running.run_until(lambda tick: tick.mode == "passive", 12.0)
    assert modes(running) == ["run", "stand", "lie-down", "passive"]
    assert running.simulated.fall_reason == ""


def test_a_policy_that_never_rests_is_not_waited_for(standing, monkeypatch):
    monkeypatch.setattr(modes_module, "_CALM_PATIENCE", 1.0)  # twice what a robot at rest is watched for
    standing.on_states = restless(1.5)
    standing.source.request = Request.LIE_DOWN
    assert standing.run(1.0).mode == "stand"
    until(standing, "lie-down", 1.0)


def test_a_robot_that_was_damped_in_its_stand_stands_up_from_where_its_legs_have_come_to_lie(standing):
    for request, mode, seconds in ((Request.STOP, "stop", 1.5), (Request.PASSIVE, "passive", 0.1)):
        standing.source.request = request
        until(standing, mode, 3.0)
        standing.run(seconds)
    standing.source.request = Request.STAND
    until(standing, "stand")
    standing.run(0.2)
    assert trunk_tilt(standing.ticks[-1].state) < 5.0


def test_an_operators_stop_is_obeyed_while_the_robot_comes_down(running):
    """After a Ctrl-C, or when the time of a run is over, the brake alone takes seconds."""
    running.controller.come_down()
    running.run_until(lambda tick: running.controller.braking, 0.021)
    running.source.request = Request.STOP
    running.run_until(lambda tick: tick.command.mode == JointMode.DAMPING, 0.021)
    assert running.controller.stop_reason == "operator"
