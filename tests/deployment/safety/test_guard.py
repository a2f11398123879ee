"""The last gate: whatever is wanted, what leaves keeps position, torque and envelope limits."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from sprintlab.deployment.interface import JointCommand, JointMode, RobotState
from sprintlab.deployment.safety import CommandGuard, implied_torque
from sprintlab.motors import torque_limits
from sprintlab.robots import load_robot

BP2 = load_robot("bp2")
GUARD = CommandGuard(BP2)
LOWER, UPPER = BP2.position_limits.T


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
