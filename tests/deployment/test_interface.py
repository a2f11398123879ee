"""Messages have one fixed layout, come back as they were, and are refused when damaged."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from sprintlab.deployment.interface import (
    JointCommand,
    JointMode,
    MessageError,
    PositionFix,
    RobotState,
    check_command,
    decode,
    encode,
    message_size,
)

whole = st.integers(0, 2**64 - 1)
number = st.floats(width=64)  # NaN and infinity too: the safety layer has to see them


def vector(size: int) -> st.SearchStrategy:
    return arrays(np.float64, size, elements=number)


states = st.builds(
    RobotState,
    sequence=whole,
    timestamp=whole,
    joint_position=vector(12),
    joint_velocity=vector(12),
    joint_torque=vector(12),
    quaternion=vector(4),
    angular_velocity=vector(3),
    bus_voltage=number,
    command_sequence=whole,
    status=st.integers(0, 7),
    session=whole,
)
commands = st.builds(
    JointCommand,
    sequence=whole,
    timestamp=whole,
    mode=st.sampled_from(JointMode),
    target_position=vector(12),
    stiffness=vector(12),
    damping=vector(12),
    feedforward_torque=vector(12),
    state_sequence=whole,
    session=whole,
)
fixes = st.builds(PositionFix, sequence=whole, timestamp=whole, position=vector(3), velocity=vector(3))


@given(st.one_of(states, commands, fixes))
def test_a_message_comes_back_to_the_last_bit(message):
    content = encode(message)
    assert len(content) == message_size(type(message), 12)
    again = decode(type(message), content)
    for field in type(message).__struct_fields__:
        np.testing.assert_array_equal(getattr(again, field), getattr(message, field))


@given(states, st.data())
def test_one_wrong_bit_is_noticed(state, data):
    content = bytearray(encode(state))
    bit = data.draw(st.integers(0, 8 * len(content) - 1))
    content[bit // 8] ^= 1 << bit % 8
    with pytest.raises(MessageError):
        decode(RobotState, content)


@given(st.binary(max_size=500))
def test_rubbish_is_refused(content):
    with pytest.raises(MessageError):
        decode(RobotState, content)


def command(**changes):
    zeros = np.zeros(12)
    sound = JointCommand(
        sequence=1,
        timestamp=2,
        mode=JointMode.SERVO,
        target_position=zeros,
        stiffness=zeros + 160.0,
        damping=zeros + 4.9,
        feedforward_torque=zeros,
    )
    return msgspec.structs.replace(sound, **changes)


def test_a_message_of_another_kind_or_length_is_refused():
    content = encode(command())
    with pytest.raises(MessageError, match="RobotState"):
        decode(RobotState, content)
    with pytest.raises(MessageError, match="bytes"):
        decode(JointCommand, content[:-1])


def test_a_message_of_more_joints_than_a_robot_has_is_refused():
    many = np.zeros(33)
    content = encode(command(target_position=many, stiffness=many, damping=many, feedforward_torque=many))
    with pytest.raises(MessageError, match="bytes"):
        decode(JointCommand, content)


def test_an_undefined_mode_is_refused():
    content = encode(command(mode=7))
    with pytest.raises(MessageError, match="not defined"):
        decode(JointCommand, content)


@pytest.mark.parametrize(
    "changes",
    [
        {"target_position": np.full(12, np.nan)},
        {"feedforward_torque": np.full(12, np.inf)},
        {"stiffness": np.full(12, -1.0)},
        {"damping": np.full(12, -1e-9)},
        {"damping": np.zeros(11)},
        {"stiffness": np.r_[np.ones(5), np.nan, np.ones(6)]},  # which the extremes of a list may pass over
        {"feedforward_torque": np.r_[np.zeros(11), np.nan]},
        {"target_position": np.full(12, 1e308)},
        {"stiffness": np.full(12, 1e308)},
        {"damping": np.full(12, 1e200)},
        {"feedforward_torque": np.full(12, -1e308)},
    ],
)
def test_a_command_that_no_robot_may_act_on_is_refused(changes):
    check_command(command(), 12)
    with pytest.raises(MessageError):
        check_command(command(**changes), 12)


def same_for_all_joints() -> st.SearchStrategy:
    return st.floats().map(lambda value: np.full(12, value)) | vector(12)


@given(
    st.builds(
        command,
        target_position=same_for_all_joints(),
        stiffness=same_for_all_joints(),
        damping=same_for_all_joints(),
        feedforward_torque=same_for_all_joints(),
    ),
    st.floats(-1e3, 1e3),
    st.floats(-100.0, 100.0),
)
def test_what_a_robot_may_act_on_gives_a_finite_torque(wanted, velocity, position):
    """Over all floats: a command is refused, or its joint law is finite at every state a joint can have."""
    try:
        check_command(wanted, 12)
    except MessageError:
        return
    with np.errstate(all="raise", under="ignore"):
        spring = wanted.stiffness * (wanted.target_position - position)
        torque = spring - wanted.damping * velocity + wanted.feedforward_torque
    assert np.isfinite(torque).all()
