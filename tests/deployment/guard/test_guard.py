"""The last gate: whatever is wanted, what leaves keeps position, torque and envelope limits."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from tests.deployment.messages import make_command, make_state

from sprintlab.deployment.controller.outgoing import CommandWriter
from sprintlab.deployment.guard import CommandGuard, implied_torque
from sprintlab.deployment.messages import JointMode, check_command
from sprintlab.motors import torque_limits
from sprintlab.robots import load_robot

BP2 = load_robot("bp2")
GUARD = CommandGuard(BP2)
POSE, STILL = np.asarray(BP2.default_pose), np.zeros(12)
LOWER, UPPER = BP2.position_limits.T
RATIO = np.asarray(BP2.gear.ratio)


def joints(low: float, high: float) -> st.SearchStrategy:
    return arrays(np.float64, 12, elements=st.floats(low, high))


def state_of(position, velocity, voltage=60.0):
    return make_state(joint_position=position, joint_velocity=velocity, bus_voltage=voltage)


def command_of(servo, mode=JointMode.SERVO):
    return make_command(mode=mode, **servo._asdict())


def envelope(state, age=0.0):
    """Ends of the envelope at the joints, over all speeds that a motor can reach meanwhile."""
    reach = age * np.asarray(BP2.motors.peak_torque) / np.asarray(BP2.motors.rotor_inertia)
    speeds = state.joint_velocity * RATIO + np.linspace(-reach, reach, 41)
    lower, upper = torque_limits(BP2.motors, speeds, min(state.bus_voltage, 75.0))
    return RATIO * lower.min(axis=0), RATIO * upper.max(axis=0)


@settings(max_examples=200)
@given(
    joints(-100.0, 100.0),
    joints(-3.0, 3.0),
    joints(-90.0, 90.0),
    st.floats(0.0, 120.0),
    st.just(0.0) | st.floats(0.0, 0.05),
)
def test_every_servo_command_keeps_every_limit(target, position, velocity, voltage, age):
    """An old state widens the envelope by the speeds within reach, and no further."""
    state = state_of(position, velocity, voltage)
    command = command_of(GUARD.servo(target, state, age))
    check_command(command, 12)
    torque = implied_torque(command, state)
    least, greatest = envelope(state, age)
    assert (torque >= least - 1e-6).all() and (torque <= greatest + 1e-6).all()
    assert (np.abs(torque) <= RATIO * np.asarray(BP2.motors.peak_torque) + 1e-6).all()
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
    torque = implied_torque(command_of(GUARD.damping(state), JointMode.DAMPING), state)
    least, greatest = envelope(state)
    assert (torque * velocity <= 0.0).all()
    assert (torque >= np.minimum(least, 0.0) - 1e-6).all()
    assert (torque <= np.maximum(greatest, 0.0) + 1e-6).all()


@given(joints(-0.15, 0.15), joints(-5.0, 5.0))
def test_what_keeps_the_limits_passes_unchanged(offset, velocity):
    servo = GUARD.servo(POSE + offset, state_of(POSE, velocity))
    wanted = (POSE + offset, BP2.stiffness, BP2.damping, np.zeros(12))
    for found, expected in zip(servo, wanted, strict=True):
        np.testing.assert_array_equal(found, expected)


def test_a_clipped_command_stays_a_spring_about_the_same_target():
    """On a robot that has moved on since, it never pushes away from where the policy wants the joint."""
    target = POSE + 0.9
    servo = GUARD.servo(target, state_of(POSE, np.full(12, 1.0)))
    assert (servo.stiffness < BP2.stiffness).any()
    np.testing.assert_allclose(servo.damping / servo.stiffness, BP2.damping / BP2.stiffness)
    reachable = (target > LOWER) & (target < UPPER)
    assert (implied_torque(command_of(servo), state_of(target, STILL))[reachable] == 0.0).all()


def test_torque_towards_a_limit_fades_in_its_last_zone():
    zone, position, asked = BP2.soft_stop.zone, POSE.copy(), []
    for depth in (0.0, 0.5, 1.0, 2.0):
        position[1] = UPPER[1] - zone * (1.0 - depth)
        state = state_of(position, STILL)
        asked.append(implied_torque(command_of(GUARD.servo(position + 5.0, state)), state)[1])
    assert asked[1] == pytest.approx(0.5 * asked[0])
    assert asked[2:] == pytest.approx([0.0, 0.0], abs=1e-9)


@given(st.integers(0, 5000), st.integers(0, 5001))
def test_the_age_of_a_state_is_counted_from_the_command_that_it_names(sent, named):
    """A command acts for a millisecond before it is reported; long ago, or never sent, is not known."""
    writer = CommandWriter(BP2, session=7)
    for number in range(sent):
        writer.off((number + 1) * 1_000_000)
    known = max(sent - 1024, 0) < named <= sent
    expected = 1e-3 * (sent - named) if known else 0.0
    age = writer.age(make_state(command_sequence=named), (sent + 1) * 1_000_000)
    assert age == pytest.approx(expected, abs=1e-9)
