"""Messages come back as they were, are refused when damaged, and ask for what a robot may act on."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from msgspec.structs import replace
from tests.deployment.messages import make_command

from sprintlab.deployment.messages import (
    JointCommand,
    JointMode,
    MessageError,
    PositionFix,
    RobotState,
    check_command,
    decode,
    encode,
)

whole = st.integers(0, 2**64 - 1)
number = st.floats(width=64)  # NaN and infinity too: the monitors have to see them


def vector(size: int) -> st.SearchStrategy:
    return arrays(np.float64, size, elements=number) | number.map(lambda value: np.full(size, value))


def message(kind: type, joints: int, **fields: st.SearchStrategy) -> st.SearchStrategy:
    """Any message of a robot with so many joints; whole numbers and vectors where nothing else is said."""
    names = [name for name in kind.__struct_fields__ if name not in fields]
    numbers = {name: whole for name in names if name in ("sequence", "timestamp", "status", "session")}
    numbers |= {name: whole for name in names if name.endswith("_sequence")}
    return st.builds(kind, **{name: numbers.get(name, vector(joints)) for name in names}, **fields)


def commands(joints: int) -> st.SearchStrategy:
    return message(JointCommand, joints, mode=st.sampled_from(JointMode))


MESSAGES = st.sampled_from((12, 13)).flatmap(
    lambda joints: (
        message(RobotState, joints, quaternion=vector(4), angular_velocity=vector(3), bus_voltage=number)
        | commands(joints)
        | message(PositionFix, 3)
    )
)


@given(MESSAGES, st.data())
def test_a_message_comes_back_to_the_last_bit_and_one_wrong_bit_is_noticed(message, data):
    content = bytearray(encode(message))
    again = decode(type(message), bytes(content))
    for field in type(message).__struct_fields__:
        np.testing.assert_array_equal(getattr(again, field), getattr(message, field))
    bit = data.draw(st.integers(0, 8 * len(content) - 1))
    content[bit // 8] ^= 1 << bit % 8
    with pytest.raises(MessageError, match="came damaged"):
        decode(type(message), bytes(content))


@pytest.mark.parametrize(
    ("kind", "content"), [(RobotState, make_command()), (JointCommand, make_command(mode=7))]
)
def test_another_kind_of_message_and_an_undefined_mode_are_refused(kind, content):
    with pytest.raises(MessageError, match=f"not a {kind.__name__}"):
        decode(kind, encode(content))


@given(commands(12), st.floats(-1e3, 1e3), st.floats(-100.0, 100.0))
def test_what_a_robot_may_act_on_gives_a_finite_torque(wanted, velocity, position):
    """Over all floats: a command is refused, or its joint law is finite at every state a joint can have."""
    try:
        check_command(wanted, 12)
    except MessageError:
        return
    assert (wanted.stiffness >= 0.0).all() and (wanted.damping >= 0.0).all()
    with np.errstate(all="raise", under="ignore"):
        spring = wanted.stiffness * (wanted.target_position - position)
        torque = spring - wanted.damping * velocity + wanted.feedforward_torque
    assert np.isfinite(torque).all()


@pytest.mark.parametrize("damping", [np.full(12, -1e-9), np.r_[np.ones(5), np.nan, np.ones(6)], np.ones(13)])
def test_a_command_that_no_robot_may_act_on_is_refused(damping):
    check_command(make_command(), 12)
    with pytest.raises(MessageError, match="damping is not 12 numbers"):
        check_command(replace(make_command(), damping=damping), 12)
