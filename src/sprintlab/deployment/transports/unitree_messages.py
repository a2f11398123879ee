"""Unitree's low-level messages of the Go2: ``LowCmd_`` and ``LowState_`` of ``unitree_go``, as bytes.

Written from the published declarations (unitree_sdk2_python at 37116c5, BSD 3-Clause); nothing here needs a
DDS library. A message is a C struct in memory, over which its checksum runs, and a CDR stream on the wire:
the same numbers in the same order, but each aligned to its own size and without the struct's end padding.
``tests/deployment/transports/unitree_vectors.json`` holds bytes and checksums made by Unitree's own code.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from sprintlab.deployment.messages import JointCommand, JointMode, MessageError, RobotState, RobotStatus

MOTORS, JOINTS = 20, 12
MOTOR_OF_JOINT = np.array([3, 4, 5, 0, 1, 2, 9, 10, 11, 6, 7, 8])
"""Unitree counts FR, FL, RR, RL; policies FL, FR, RL, RR. Its own inverse."""
SERVO_MODE, STOP_MODE = 1, 0
"""Mode bytes of a motor: field-oriented control, and stopped."""
NO_POSITION, NO_VELOCITY = 2.146e9, 16000.0
"""What the SDK writes into ``q`` and ``dq`` of a motor that shall not follow them."""
_HEAD, _LOW_LEVEL = (0xFE, 0xEF), 0xFF
_CDR_LITTLE_ENDIAN = b"\x00\x01\x00\x00"


def _struct(*fields: Any) -> np.dtype[np.void]:
    return np.dtype(list(fields), align=True)


_MOTOR_CMD = _struct(
    ("mode", "u1"), ("q", "<f4"), ("dq", "<f4"), ("tau", "<f4"), ("kp", "<f4"), ("kd", "<f4"),
    ("reserve", "<u4", 3),
)  # fmt: skip
_BMS_CMD = _struct(("off", "u1"), ("reserve", "u1", 3))
_IMU_STATE = _struct(
    ("quaternion", "<f4", 4), ("gyroscope", "<f4", 3), ("accelerometer", "<f4", 3), ("rpy", "<f4", 3),
    ("temperature", "u1"),
)  # fmt: skip
_MOTOR_STATE = _struct(
    ("mode", "u1"), ("q", "<f4"), ("dq", "<f4"), ("ddq", "<f4"), ("tau_est", "<f4"), ("q_raw", "<f4"),
    ("dq_raw", "<f4"), ("ddq_raw", "<f4"), ("temperature", "u1"), ("lost", "<u4"), ("reserve", "<u4", 2),
)  # fmt: skip
_BMS_STATE = _struct(
    ("version_high", "u1"), ("version_low", "u1"), ("status", "u1"), ("soc", "u1"), ("current", "<i4"),
    ("cycle", "<u2"), ("bq_ntc", "u1", 2), ("mcu_ntc", "u1", 2), ("cell_vol", "<u2", 15),
)  # fmt: skip
_HEADER_FIELDS = (
    ("head", "u1", 2), ("level_flag", "u1"), ("frame_reserve", "u1"), ("sn", "<u4", 2), ("version", "<u4", 2),
    ("bandwidth", "<u2"),
)  # fmt: skip
LOW_COMMAND = _struct(
    *_HEADER_FIELDS, ("motor_cmd", _MOTOR_CMD, MOTORS), ("bms_cmd", _BMS_CMD), ("wireless_remote", "u1", 40),
    ("led", "u1", 12), ("fan", "u1", 2), ("gpio", "u1"), ("reserve", "<u4"), ("crc", "<u4"),
)  # fmt: skip
LOW_STATE = _struct(
    *_HEADER_FIELDS, ("imu_state", _IMU_STATE), ("motor_state", _MOTOR_STATE, MOTORS),
    ("bms_state", _BMS_STATE), ("foot_force", "<i2", 4), ("foot_force_est", "<i2", 4), ("tick", "<u4"),
    ("wireless_remote", "u1", 40), ("bit_flag", "u1"), ("adc_reel", "<f4"), ("temperature_ntc1", "u1"),
    ("temperature_ntc2", "u1"), ("power_v", "<f4"), ("power_a", "<f4"), ("fan_frequency", "<u2", 4),
    ("reserve", "<u4"), ("crc", "<u4"),
)  # fmt: skip
STRUCTURES = {
    "MotorCmd_": _MOTOR_CMD, "BmsCmd_": _BMS_CMD, "IMUState_": _IMU_STATE, "MotorState_": _MOTOR_STATE,
    "BmsState_": _BMS_STATE, "LowCmd_": LOW_COMMAND, "LowState_": LOW_STATE,
}  # fmt: skip
"""The C structs, by Unitree's names."""


def _numbers(type_: np.dtype[Any], offset: int = 0) -> Iterator[tuple[int, int]]:
    """Place in memory and size of every single number of a struct, in order."""
    if type_.subdtype is not None:
        element, shape = type_.subdtype
        for index in range(int(np.prod(shape))):
            yield from _numbers(element, offset + index * element.itemsize)
    elif type_.names is None:
        yield offset, type_.itemsize
    else:
        for field, place, *_ in (type_.fields or {}).values():
            yield from _numbers(field, offset + place)


class _Wire:
    """How a struct's bytes lie in a CDR stream."""

    def __init__(self, type_: np.dtype[np.void]) -> None:
        stream: list[int] = []
        memory: list[int] = []
        place = 0
        for offset, size in _numbers(type_):
            place += -place % size
            stream.extend(range(place, place + size))
            memory.extend(range(offset, offset + size))
            place += size
        self.type, self.size = type_, len(_CDR_LITTLE_ENDIAN) + place
        self._stream, self._memory = np.array(stream), np.array(memory)

    def write(self, record: npt.NDArray[Any]) -> bytes:
        content = np.zeros(self.size - len(_CDR_LITTLE_ENDIAN), np.uint8)
        content[self._stream] = np.frombuffer(record.tobytes(), np.uint8)[self._memory]
        return _CDR_LITTLE_ENDIAN + content.tobytes()

    def read(self, data: bytes) -> npt.NDArray[Any]:
        content = np.frombuffer(data, np.uint8)[len(_CDR_LITTLE_ENDIAN) :]
        memory = np.zeros(self.type.itemsize, np.uint8)
        memory[self._memory] = content[self._stream]
        return memory.view(self.type)[0]


_WIRES = {"LowCmd_": _Wire(LOW_COMMAND), "LowState_": _Wire(LOW_STATE)}
_REVERSED_BITS = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))


def checksum(record: npt.NDArray[Any]) -> int:
    """Unitree's CRC-32 of a struct in memory, whose last four bytes, the checksum itself, do not count.

    Polynomial 0x04C11DB7, most significant bit first, over the little-endian words, from 0xFFFFFFFF, not
    inverted at the end: the mirror image of ``zlib``'s.
    """
    words = np.frombuffer(record.tobytes()[:-4], "<u4").byteswap().tobytes()
    mirrored = zlib.crc32(words.translate(_REVERSED_BITS)) ^ 0xFFFFFFFF
    return int(f"{mirrored:032b}"[::-1], 2)


def to_wire(name: str, record: npt.NDArray[Any]) -> bytes:
    """The CDR stream of a struct, its checksum put in."""
    record["crc"] = checksum(record)
    return _WIRES[name].write(record)


def from_wire(name: str, data: bytes) -> npt.NDArray[Any]:
    """The struct of a CDR stream.

    Raises:
        MessageError: wrong length, another encoding, or a checksum that does not fit.
    """
    wire = _WIRES[name]
    if len(data) != wire.size:
        raise MessageError(f"a {name} has {wire.size} bytes, but {len(data)} came")
    if data[:2] != _CDR_LITTLE_ENDIAN[:2]:
        raise MessageError(f"a {name} came in encoding {data[:2].hex()}, not plain little-endian CDR")
    record = wire.read(data)
    if checksum(record) != int(record["crc"]):
        raise MessageError(f"a {name} came damaged: its checksum does not fit")
    return record


def _new_message(structure: np.dtype[np.void], joints: int) -> npt.NDArray[Any]:
    """A low-level message of zeros; refuses another robot's number of joints."""
    if joints != JOINTS:
        raise MessageError(f"the Go2's messages are for {JOINTS} joints, and this robot has {joints}")
    record = np.zeros((), structure)
    record["head"], record["level_flag"] = _HEAD, _LOW_LEVEL
    return record


def encode_command(command: JointCommand) -> bytes:
    """A command as ``LowCmd_``; its number and session have no place there.

    ``OFF`` is what the SDK's example sends first: all motors on, none asked for anything.
    """
    record = _new_message(LOW_COMMAND, len(command.damping))
    motors, chosen = record["motor_cmd"], MOTOR_OF_JOINT
    motors["mode"], motors["q"], motors["dq"] = SERVO_MODE, NO_POSITION, NO_VELOCITY
    if command.mode != JointMode.OFF:
        motors["dq"][chosen] = 0.0
        motors["kd"][chosen] = command.damping
    if command.mode == JointMode.SERVO:
        motors["q"][chosen] = command.target_position
        motors["kp"][chosen] = command.stiffness
        motors["tau"][chosen] = command.feedforward_torque
    return to_wire("LowCmd_", record)


def decode_command(data: bytes, *, sequence: int, session: int, state_sequence: int) -> JointCommand:
    """What a ``LowCmd_`` asks of the joints; what it cannot say the receiver adds.

    A motor's law is ``kp (q - position) + kd (dq - velocity) + tau``; a wanted velocity becomes torque.

    Raises:
        MessageError: as ``from_wire``; another head or level; some motors on and others off.
    """
    record = from_wire("LowCmd_", data)
    if tuple(record["head"]) != _HEAD or record["level_flag"] != _LOW_LEVEL:
        raise MessageError("a LowCmd_ came whose head or level flag is not that of a low-level command")
    motors = record["motor_cmd"][MOTOR_OF_JOINT]
    modes = set(motors["mode"].tolist())
    if modes not in ({SERVO_MODE}, {STOP_MODE}):
        raise MessageError(f"a LowCmd_ has motors in modes {modes}; all must be in 1 (servo) or in 0 (stop)")
    stiffness, damping = motors["kp"].astype(float), motors["kd"].astype(float)
    feedforward = motors["tau"] + damping * motors["dq"]
    target = np.where(stiffness == 0.0, 0.0, motors["q"].astype(float))
    mode = JointMode.SERVO
    if modes == {STOP_MODE} or not (stiffness.any() or damping.any() or feedforward.any()):
        mode = JointMode.OFF
    elif not (stiffness.any() or feedforward.any()):
        mode = JointMode.DAMPING
    return JointCommand(
        sequence=sequence,
        timestamp=0,
        mode=mode,
        target_position=target,
        stiffness=stiffness,
        damping=damping,
        feedforward_torque=feedforward,
        state_sequence=state_sequence,
        session=session,
    )


def encode_state(state: RobotState) -> bytes:
    """A state as ``LowState_``, as a robot sends it.

    A robot that damps its joints by itself shows all motors stopped; one with a failed drive shows one.
    Accelerations, raw values, foot forces and the battery stay zero: a ``RobotState`` has none of them.
    """
    record = _new_message(LOW_STATE, len(state.joint_position))
    record["tick"] = state.timestamp // 1_000_000 & 0xFFFFFFFF
    record["power_v"] = state.bus_voltage
    record["imu_state"]["quaternion"] = state.quaternion
    record["imu_state"]["gyroscope"] = state.angular_velocity
    motors, chosen = record["motor_state"], MOTOR_OF_JOINT
    motors["q"][chosen], motors["dq"][chosen] = state.joint_position, state.joint_velocity
    motors["tau_est"][chosen] = state.joint_torque
    motors["mode"] = STOP_MODE if state.status & RobotStatus.WATCHDOG_EXPIRED else SERVO_MODE
    if state.status & RobotStatus.DRIVE_FAULT:
        motors["mode"][0] = STOP_MODE
    return to_wire("LowState_", record)


def decode_state(data: bytes) -> tuple[int, RobotState]:
    """The robot's clock [ms, 32 bits] and its state, still without sequence, time, and whom it obeys."""
    record = from_wire("LowState_", data)
    motors = record["motor_state"][MOTOR_OF_JOINT]
    on = motors["mode"] == SERVO_MODE
    status = RobotStatus.READY
    if not on.any():
        status = RobotStatus.WATCHDOG_EXPIRED
    elif not on.all():
        status = RobotStatus.DRIVE_FAULT
    return int(record["tick"]), RobotState(
        sequence=0,
        timestamp=0,
        joint_position=motors["q"].astype(float),
        joint_velocity=motors["dq"].astype(float),
        joint_torque=motors["tau_est"].astype(float),
        quaternion=record["imu_state"]["quaternion"].astype(float),
        angular_velocity=record["imu_state"]["gyroscope"].astype(float),
        bus_voltage=float(record["power_v"]),
        status=int(status),
    )
