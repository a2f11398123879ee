"""Messages have one fixed layout, come back as they were, and are refused when damaged."""

from __future__ import annotations

import zlib

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from sprintlab.deployment.interface import (
    COMMAND_BOUNDS,
    JointCommand,
    JointMode,
    MessageError,
    OperatorCommand,
    PositionFix,
    Request,
    RobotState,
    check_command,
    command_digest,
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
    foreign_commands=whole,
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
operators = st.builds(
    OperatorCommand, sequence=whole, timestamp=whole, velocity=vector(3), request=st.sampled_from(Request)
)


@given(st.one_of(states, commands, fixes, operators))
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
def test_a_command_nobody_may_act_on_is_refused(changes):
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


def a_command(torque: np.ndarray) -> JointCommand:
    zeros = np.zeros(12)
    return JointCommand(
        sequence=1,
        timestamp=0,
        mode=JointMode.SERVO,
        target_position=zeros,
        stiffness=zeros,
        damping=zeros,
        feedforward_torque=torque,
    )


@pytest.mark.parametrize("field", ["mode", *COMMAND_BOUNDS])
def test_a_digest_tells_of_every_field(field):
    """A robot that was told to switch its drives off obeys somebody else, whatever else stood in it."""
    ours = command()
    value = JointMode.OFF if field == "mode" else np.nextafter(getattr(ours, field), 1e3)
    assert command_digest(command(**{field: value})) != command_digest(ours)
    assert command_digest(command(sequence=9, timestamp=9)) == command_digest(ours)


def checksum_of(torque: np.ndarray) -> int:
    return zlib.crc32(torque.tobytes(), int(JointMode.SERVO))


def forged(goal: int, torque: np.ndarray) -> np.ndarray:
    """The same torques to 1e-6, with this CRC-32: each of 32 bits turns known bits of it around."""
    numbers = torque.view(np.uint64).copy()
    start = checksum_of(torque)
    rows: dict[int, tuple[int, int]] = {}  # by highest bit: what a choice of bits changes, and the choice
    for bit in range(32):
        turned = numbers.copy()
        turned[0] ^= np.uint64(1 << bit)
        change, choice = checksum_of(turned.view(np.float64)) ^ start, 1 << bit
        while change and change.bit_length() in rows:
            other = rows[change.bit_length()]
            change, choice = change ^ other[0], choice ^ other[1]
        rows[change.bit_length()] = change, choice
    wanted, turn = start ^ goal, 0
    while wanted:
        change, choice = rows[wanted.bit_length()]
        wanted, turn = wanted ^ change, turn ^ choice
    numbers[0] ^= np.uint64(turn)
    return numbers.view(np.float64)


def test_no_other_command_can_be_made_to_have_the_same_digest_as_a_checksum_can() -> None:
    """Who foresees a command, and a robot that stands gets many alike, may send his own before it."""
    ours = np.zeros(12)
    theirs = forged(checksum_of(ours), np.full(12, 30.0))
    assert checksum_of(theirs) == checksum_of(ours)
    assert np.allclose(theirs, 30.0, atol=1e-4)
    assert command_digest(a_command(theirs)) != command_digest(a_command(ours))
