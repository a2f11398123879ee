"""Unitree's messages against bytes and checksums that Unitree's own code made (``unitree_vectors.json``)."""

import json
from pathlib import Path

import numpy as np
import pytest
from tests.deployment.messages import make_command, make_state

from sprintlab.deployment.bus.unitree_messages import (
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
from sprintlab.deployment.interface import (
    JointMode,
    MessageError,
    RobotStatus,
    check_command,
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


def state(**fields):
    usual = {
        "timestamp": 3_000_000_000,
        "joint_position": np.linspace(-1.0, 1.0, 12),
        "joint_velocity": np.linspace(-20.0, 20.0, 12),
        "joint_torque": np.arange(12.0),
        "quaternion": np.array([0.5, 0.5, -0.5, 0.5]),
        "angular_velocity": np.array([0.1, 0.2, 0.3]),
        "bus_voltage": 28.5,
    }
    return make_state(**(usual | fields))


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
    from sprintlab.deployment.bus.unitree_bus import _declared

    random = np.random.default_rng(0)
    for _ in range(20):  # bytes below 64: every float of them is finite
        content = random.integers(0, 64, structure.itemsize, np.uint8)
        ours = to_wire(name, content.view(structure)[0].copy())
        assert ours == _declared()[name].deserialize(ours).serialize()


def test_first_and_last_command_are_those_of_the_sdks_example():
    assert encode_command(command(JointMode.OFF)).hex() == VECTORS["idle"]["wire"]
    assert encode_command(command()).hex() == VECTORS["last"]["wire"]


def test_legs_are_exchanged_and_back():
    np.testing.assert_array_equal(MOTOR_OF_JOINT[MOTOR_OF_JOINT], np.arange(12))
    record = from_wire("LowCmd_", encode_command(command(target_position=np.arange(12.0))))
    assert record["motor_cmd"]["q"][:12].tolist() == [3, 4, 5, 0, 1, 2, 9, 10, 11, 6, 7, 8]


@pytest.mark.parametrize("mode", list(JointMode))
def test_a_command_comes_back_as_the_same_torque(mode):
    sent = command(mode, feedforward_torque=np.linspace(-3.0, 3.0, 12))
    back = received(encode_command(sent))
    assert back.mode == mode and (back.sequence, back.session, back.state_sequence) == (1, 2, 3)
    if mode == JointMode.SERVO:
        np.testing.assert_allclose(back.target_position, sent.target_position, rtol=1e-6)
        np.testing.assert_allclose(back.feedforward_torque, sent.feedforward_torque, rtol=1e-6)
        np.testing.assert_array_equal(back.stiffness, sent.stiffness)
    if mode != JointMode.OFF:
        np.testing.assert_array_equal(back.damping, sent.damping)
    check_command(back, 12)


def test_a_wanted_velocity_becomes_torque():
    record = from_wire("LowCmd_", encode_command(command()))
    record["motor_cmd"]["dq"][3] = 2.0  # FL_abad
    assert received(to_wire("LowCmd_", record)).feedforward_torque[0] == 10.0


def test_a_state_comes_back_in_single_precision():
    sent = state()
    tick, back = decode_state(encode_state(sent))
    assert tick == 3000 and back.status == RobotStatus.READY
    for field in ("joint_position", "joint_velocity", "joint_torque", "quaternion", "angular_velocity"):
        np.testing.assert_allclose(getattr(back, field), getattr(sent, field), rtol=1e-7)
    assert back.bus_voltage == 28.5
    for status in (RobotStatus.WATCHDOG_EXPIRED, RobotStatus.DRIVE_FAULT):
        assert decode_state(encode_state(state(status=int(status))))[1].status == status


def test_a_robot_with_another_number_of_joints_is_refused():
    for build in (
        lambda: encode_command(command(damping=np.ones(13))),
        lambda: encode_state(state(joint_position=np.ones(13))),
    ):
        with pytest.raises(MessageError, match="12 joints, and this robot has 13"):
            build()


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda data: data[:-1], "has 812 bytes, but 811 came"),
        (lambda data: bytes(len(data)), "encoding 0000"),
        (lambda data: data[:60] + b"\xff" + data[61:], "checksum"),
    ],
)
def test_what_is_no_message_is_refused(change, sentence):
    with pytest.raises(MessageError, match=sentence):
        received(change(encode_command(command())))


@pytest.mark.parametrize(
    ("field", "value", "sentence"),
    [
        ("level_flag", 0xEE, "not that of a low-level command"),
        ("head", (0, 0), "not that of a low-level command"),
        ("mode", 0x0A, "motor mode 10"),
        ("mode", 0, "some of the twelve motors"),
    ],
)
def test_a_command_for_something_else_is_refused(field, value, sentence):
    record = from_wire("LowCmd_", encode_command(command()))
    if field == "mode":
        record["motor_cmd"]["mode"][2] = value
    else:
        record[field] = value
    with pytest.raises(MessageError, match=sentence):
        received(to_wire("LowCmd_", record))
