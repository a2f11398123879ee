"""The last gate: whatever is wanted, what leaves keeps position, torque and envelope limits."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from sprintlab.deployment.controller import Controller
from sprintlab.deployment.interface import (
    COMMAND_BOUNDS,
    JointCommand,
    JointMode,
    OperatorCommand,
    Request,
    RobotState,
)
from sprintlab.deployment.safety import CommandGuard, LinkAge, implied_torque
from sprintlab.deployment.simulator import LinkOptions, SimulatedWorld, SimulatorOptions
from sprintlab.motors import torque_limits
from sprintlab.robots import load_robot

BP2 = load_robot("bp2")
GUARD = CommandGuard(BP2)
LOWER, UPPER = BP2.position_limits.T


class StandUp:
    """Asks to stand up, for ever."""

    def __init__(self):
        self.sequence = 0

    def read(self, view):
        self.sequence += 1
        return OperatorCommand(
            sequence=self.sequence, timestamp=0, velocity=np.zeros(3), request=Request.STAND
        )

    def close(self):
        pass


def joints(low: float, high: float) -> st.SearchStrategy:
    return arrays(np.float64, 12, elements=st.floats(low, high))


def state_of(position, velocity, voltage=60.0):
    return RobotState(
        sequence=1,
        timestamp=1,
        joint_position=position,
        joint_velocity=velocity,
        joint_torque=np.zeros(12),
        quaternion=np.array([1.0, 0.0, 0.0, 0.0]),
        angular_velocity=np.zeros(3),
        bus_voltage=voltage,
    )


def command_of(servo, mode=JointMode.SERVO):
    return JointCommand(sequence=1, timestamp=0, mode=mode, **servo._asdict())


def envelope(state):
    ratio = np.asarray(BP2.gear.ratio)
    limits = torque_limits(BP2.motors, state.joint_velocity * ratio, min(state.bus_voltage, 75.0))
    return ratio * limits[0], ratio * limits[1]


@settings(max_examples=200)
@given(joints(-50.0, 50.0), joints(-3.0, 3.0), joints(-90.0, 90.0), st.floats(0.0, 120.0))
def test_every_servo_command_keeps_every_limit(target, position, velocity, voltage):
    state = state_of(position, velocity, voltage)
    command = command_of(GUARD.servo(target, BP2.stiffness, BP2.damping, state))
    torque = implied_torque(command, state)
    least, greatest = envelope(state)
    assert (torque >= least - 1e-6).all() and (torque <= greatest + 1e-6).all()
    assert (command.target_position >= LOWER).all() and (command.target_position <= UPPER).all()
    assert ((command.stiffness >= 0.0) & (command.stiffness <= BP2.stiffness)).all()
    assert ((command.damping >= 0.0) & (command.damping <= BP2.damping)).all()
    free = (least <= 0.0) & (greatest >= 0.0)  # else the back-EMF decides, not the command
    assert (torque[(position >= UPPER) & free] <= 1e-6).all()  # never further into a stop
    assert (torque[(position <= LOWER) & free] >= -1e-6).all()


@settings(max_examples=200)
@given(joints(-3.0, 3.0), joints(-90.0, 90.0), st.floats(0.0, 120.0))
def test_damping_only_takes_energy_out_and_keeps_the_envelope(position, velocity, voltage):
    state = state_of(position, velocity, voltage)
    torque = implied_torque(command_of(GUARD.damping(BP2.damping, state), JointMode.DAMPING), state)
    least, greatest = envelope(state)
    assert (torque * velocity <= 0.0).all()
    assert (torque >= np.minimum(least, 0.0) - 1e-6).all()
    assert (torque <= np.maximum(greatest, 0.0) + 1e-6).all()


@given(joints(-0.15, 0.15), joints(-5.0, 5.0))
def test_what_keeps_the_limits_passes_unchanged(offset, velocity):
    pose = np.asarray(BP2.default_pose)
    servo = GUARD.servo(pose + offset, BP2.stiffness, BP2.damping, state_of(pose, velocity))
    np.testing.assert_array_equal(servo.target_position, pose + offset)
    np.testing.assert_array_equal(servo.stiffness, BP2.stiffness)
    np.testing.assert_array_equal(servo.damping, BP2.damping)
    np.testing.assert_array_equal(servo.feedforward_torque, np.zeros(12))


def test_a_clipped_command_stays_a_spring_about_the_same_target():
    """On a robot that has moved on since, it never pushes away from where the policy wants the joint."""
    pose = np.asarray(BP2.default_pose)
    target = pose + 0.9
    servo = GUARD.servo(target, BP2.stiffness, BP2.damping, state_of(pose, np.full(12, 1.0)))
    assert (servo.stiffness < BP2.stiffness).any()
    np.testing.assert_allclose(servo.damping / servo.stiffness, BP2.damping / BP2.stiffness)
    moved_on = state_of(target, np.zeros(12))
    reachable = (target > LOWER) & (target < UPPER)
    assert (implied_torque(command_of(servo), moved_on)[reachable] == 0.0).all()


@settings(max_examples=100)
@given(joints(-3.0, 3.0), joints(-60.0, 60.0), st.floats(10.0, 75.0), st.floats(0.0, 0.05))
def test_an_old_state_widens_the_envelope_by_the_speeds_within_reach_and_no_further(
    position, velocity, voltage, age
):
    state = state_of(position, velocity, voltage)
    command = command_of(GUARD.servo(position + 3.0, BP2.stiffness, BP2.damping, state, age))
    torque = implied_torque(command, state)
    ratio = np.asarray(BP2.gear.ratio)
    reach = age * np.asarray(BP2.motors.peak_torque) / np.asarray(BP2.motors.rotor_inertia)
    speeds = velocity * ratio + np.linspace(-reach, reach, 41)
    lower, upper = torque_limits(BP2.motors, speeds, voltage)
    assert (torque >= ratio * lower.min(axis=0) - 1e-6).all()
    assert (torque <= ratio * upper.max(axis=0) + 1e-6).all()
    assert (np.abs(torque) <= ratio * np.asarray(BP2.motors.peak_torque) + 1e-6).all()


def test_an_old_state_does_not_weaken_what_a_slower_joint_may_give():
    pose, fast = np.asarray(BP2.default_pose), np.full(12, 35.0)
    state = state_of(pose, fast)
    legs = np.arange(12) % 3 > 0
    torque = [
        implied_torque(command_of(GUARD.servo(pose + 0.6, BP2.stiffness, np.zeros(12), state, age)), state)
        for age in (0.0, 0.001, 0.004)
    ]
    assert (torque[0] < torque[1])[legs].all() and (torque[1] < torque[2])[legs].all()


def test_the_age_of_a_state_is_counted_from_the_command_that_it_names():
    link = LinkAge()
    assert link.both_ways(0, 10**9) == 0.0  # nothing was sent
    for number in range(1, 5000):
        link.sent(number, number * 1_000_000)
    assert link.both_ways(4999, 5000 * 1_000_000) == 0.0  # answered a millisecond later: no way at all
    assert link.both_ways(4992, 5000 * 1_000_000) == pytest.approx(0.007)
    assert link.both_ways(7, 5000 * 1_000_000) == 0.0  # too long ago to be known
    assert link.both_ways(2**64 - 1, 5000 * 1_000_000) == 0.0  # never sent


@pytest.mark.parametrize("each_way_ms", [0, 3])
def test_the_controller_measures_the_link(robot, sprint_policy, each_way_ms):
    """The ages that reach the guard while a robot stands up are those of the simulated link."""
    link = LinkOptions(delay=1e-3 * each_way_ms)
    world = SimulatedWorld(robot, SimulatorOptions(to_controller=link, to_robot=link, fix_rate=0.0))
    controller = Controller(sprint_policy, robot, StandUp())
    ages = []
    servo = controller._commands.guard.servo
    controller._commands.guard.servo = lambda *given: ages.append(given[-1]) or servo(*given)
    while world.time < 0.6:
        now = round(1e9 * world.time)
        states = [state for state in world.messages(now) if isinstance(state, RobotState)]
        world.hand_over(controller.step(now, states).command)
        world.step()
    assert len(ages) > 400
    assert ages[50:] == pytest.approx([2e-3 * each_way_ms] * len(ages[50:]), abs=1e-9)


def any_joints() -> st.SearchStrategy:
    """Every float there is, for all joints alike or for each its own."""
    return st.floats().map(lambda value: np.full(12, value)) | arrays(np.float64, 12, elements=st.floats())


@settings(max_examples=300)
@given(any_joints(), any_joints(), any_joints(), st.floats(), st.floats(0.0, 1.0))
def test_whatever_is_given_what_leaves_may_be_acted_on(target, position, velocity, voltage, age):
    state = state_of(position, velocity, voltage)
    servo = GUARD.servo(target, BP2.stiffness, BP2.damping, state, age)
    if servo is not None:
        assert_bounded(command_of(servo))
    assert_bounded(command_of(GUARD.damping(BP2.damping, state), JointMode.DAMPING))


def assert_bounded(command: JointCommand) -> None:
    """In numbers of its own: the guard asks ``check_command``'s own function."""
    for field, (least, greatest) in COMMAND_BOUNDS.items():
        numbers = getattr(command, field)
        assert numbers.shape == (12,) and np.isfinite(numbers).all(), field
        assert least <= numbers.min() and numbers.max() <= greatest, field


@pytest.mark.parametrize("target", [np.nan, np.inf, -1e308, 1e308, 1e200])
def test_an_absurd_target_is_refused(target):
    still = state_of(np.asarray(BP2.default_pose), np.zeros(12))
    assert GUARD.servo(np.full(12, target), BP2.stiffness, BP2.damping, still) is None


def test_torque_towards_a_limit_fades_in_its_last_zone():
    zone, position = BP2.soft_stop.zone, np.asarray(BP2.default_pose).copy()
    asked = []
    for depth in (0.0, 0.5, 1.0, 2.0):
        position[1] = UPPER[1] - zone * (1.0 - depth)
        state = state_of(position, np.zeros(12))
        command = command_of(GUARD.servo(position + 5.0, BP2.stiffness, BP2.damping, state))
        asked.append(implied_torque(command, state)[1])
    assert asked[1] == pytest.approx(0.5 * asked[0])
    assert asked[2] == pytest.approx(0.0, abs=1e-9) and asked[3] == pytest.approx(0.0, abs=1e-9)
