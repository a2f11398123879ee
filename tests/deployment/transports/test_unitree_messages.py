"""Unitree's messages against bytes and checksums that Unitree's own code made (``unitree_vectors.json``)."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from tests.deployment.messages import make_command, make_state

from sprintlab.deployment.messages import JointMode, MessageError, RobotStatus, check_command
from sprintlab.deployment.transports.unitree_messages import (
    LOW_COMMAND,
    LOW_STATE,
    MOTOR_OF_JOINT,
    checksum,
    decode_command,
    decode_state,
    encode_command,
    encode_state,
    from_wire,
    to_wire,
)

VECTORS = json.loads((Path(__file__).parent / "unitree_vectors.json").read_text(encoding="utf-8"))["vectors"]
CROUCH = [-0.35, 1.36, -2.65, 0.35, 1.36, -2.65, -0.5, 1.36, -2.65, 0.5, 1.36, -2.65]
"""``_targetPos_3`` of the SDK's stand example, its last pose, in Unitree's order."""


def command(mode=JointMode.SERVO, **fields):
    usual = {
        "target_position": np.array(CROUCH)[MOTOR_OF_JOINT],
        "stiffness": np.full(12, 60.0),
        "damping": np.full(12, 5.0),
    }
    return make_command(mode=mode, **(usual | fields))


def received(data):
    return decode_command(data, sequence=1, session=2, state_sequence=3)


@pytest.mark.parametrize("title", VECTORS)
def test_bytes_and_checksums_are_unitrees(title):
    vector = VECTORS[title]
    record = from_wire(vector["message"], bytes.fromhex(vector["wire"]))
    assert checksum(record) == vector["checksum"]
    assert to_wire(vector["message"], record).hex() == vector["wire"]
    for words, expected in vector["says"].items() if isinstance(vector["says"], dict) else ():
        value = record
        for word in words.split():
            value = value[int(word) if word.isdecimal() else word]
        np.testing.assert_array_equal(value, expected)


@pytest.mark.parametrize(("name", "structure"), [("LowCmd_", LOW_COMMAND), ("LowState_", LOW_STATE)])
def test_random_messages_have_the_bytes_of_cyclone_dds(name, structure):
    """The library's own serializer takes 160 us for a command, which a loop of 1 kHz cannot spare."""
    pytest.importorskip("cyclonedds")
    from sprintlab.deployment.transports.unitree_dds import _declared

    random = np.random.default_rng(0)
    for _ in range(20):  # bytes below 64: every float of them is finite
        content = random.integers(0, 64, structure.itemsize, np.uint8)
        ours = to_wire(name, content.view(structure)[0].copy())
        assert ours == _declared()[name].deserialize(ours).serialize()


def test_first_and_last_command_are_those_of_the_sdks_example():
    assert encode_command(command(JointMode.OFF)).hex() == VECTORS["idle"]["wire"]
    assert encode_command(command()).hex() == VECTORS["last"]["wire"]


joints = arrays(np.float64, 12, elements=st.floats(-30.0, 30.0, width=32))
gains = arrays(np.float64, 12, elements=st.floats(0.0, 100.0, width=32).map(lambda gain: gain + 1.0))


@given(st.sampled_from(JointMode), joints, joints, gains, gains)
def test_a_command_comes_back_as_the_same_torque(mode, target, torque, stiffness, damping):
    fields = {"target_position": target, "stiffness": stiffness, "feedforward_torque": torque}
    back = received(encode_command(command(mode, damping=damping, **fields)))
    assert (back.mode, back.sequence, back.session, back.state_sequence) == (mode, 1, 2, 3)
    for name, sent in fields.items() if mode == JointMode.SERVO else ():
        np.testing.assert_allclose(getattr(back, name), sent, rtol=1e-6)
    if mode != JointMode.OFF:
        np.testing.assert_allclose(back.damping, damping, rtol=1e-6)
    check_command(back, 12)


def test_legs_are_exchanged_and_a_wanted_velocity_becomes_torque():
    record = from_wire("LowCmd_", encode_command(command(target_position=np.arange(12.0))))
    assert record["motor_cmd"]["q"][:12].tolist() == [3, 4, 5, 0, 1, 2, 9, 10, 11, 6, 7, 8]
    record["motor_cmd"]["dq"][3] = 2.0  # FL_abad
    assert received(to_wire("LowCmd_", record)).feedforward_torque[0] == 10.0


@given(joints, joints, joints, st.sampled_from((0, *RobotStatus)))
def test_a_state_comes_back_in_single_precision(position, velocity, torque, status):
    fields = {"joint_position": position, "joint_velocity": velocity, "joint_torque": torque}
    fields |= {"quaternion": np.array([0.5, 0.5, -0.5, 0.5]), "angular_velocity": np.array([0.1, 0.2, 0.3])}
    sent = make_state(timestamp=3_000_000_000, bus_voltage=28.5, status=int(status), **fields)
    tick, back = decode_state(encode_state(sent))
    assert (tick, back.status, back.bus_voltage) == (3000, status, 28.5)
    for name, value in fields.items():
        np.testing.assert_allclose(getattr(back, name), value, rtol=1e-7)


def test_a_robot_with_another_number_of_joints_is_refused():
    for build in (
        lambda: encode_command(command(damping=np.ones(13))),
        lambda: encode_state(make_state(joint_position=np.ones(13))),
    ):
        with pytest.raises(MessageError, match="12 joints, and this robot has 13"):
            build()


def changed(**fields):
    """The bytes of a command with other numbers in it."""
    record = from_wire("LowCmd_", encode_command(command()))
    for field, value in fields.items():
        (record["motor_cmd"][2] if field == "mode" else record)[field] = value
    return to_wire("LowCmd_", record)


SOUND = encode_command(command())


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (SOUND[:-1], "has 812 bytes, but 811 came"),
        (SOUND[:60] + b"\xff" + SOUND[61:], "checksum"),
        (changed(head=(0, 0)), "not that of a low-level command"),
        (changed(mode=0), "has motors in modes"),
    ],
)
def test_what_a_robot_may_not_act_on_is_refused(content, sentence):
    with pytest.raises(MessageError, match=sentence):
        received(content)
