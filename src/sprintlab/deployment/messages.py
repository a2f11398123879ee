"""What a controller and a robot say to each other: message types and their bytes.

A message's bytes are its fields as MessagePack, arrays as doubles, and the CRC-32 of all before it. Joints
are in policy order, SI units. A ``timestamp`` is nanoseconds of the *sender's* monotonic clock: it orders
messages of one sender and is never compared with the receiver's clock.

Duties of the robot's end, whatever robot it is:

1. It applies ``stiffness (target - position) - damping velocity + feedforward`` in ``SERVO``, only
   ``-damping velocity`` in ``DAMPING``, nothing in ``OFF``, at 1 kHz or faster, clipped to the motors'
   envelope at the speed and bus voltage of the moment: the controller knows those of its last state only.
2. It drops a command whose sequence is not above the last accepted one of the same session, or that
   ``check_command`` refuses; a dropped command does not feed the watchdog.
3. **Watchdog**: ``WATCHDOG_TIMEOUT`` after the last accepted command (and from power-up on) it applies
   ``DAMPING`` with the robot description's damping, sets ``RobotStatus.WATCHDOG_EXPIRED``, and *latches*:
   ``SERVO`` commands are dropped until a ``DAMPING`` or ``OFF`` command is accepted, which clears the flag.
4. It publishes ``RobotState`` at 1 kHz with sequence numbers that rise by one, and reports in ``session``
   and ``command_sequence`` whose command it accepted last, and which.
5. **One controller**: it is bound to the session of the last accepted command until the watchdog expires, and
   drops commands of every other session.
"""

from __future__ import annotations

import enum
import math
import zlib
from typing import Any, TypeVar

import msgspec
import numpy as np
import numpy.typing as npt

from sprintlab.core.errors import SprintlabError

FloatArray = npt.NDArray[np.float64]

WATCHDOG_TIMEOUT = 0.05
"""Seconds without an accepted command after which the robot damps its joints by itself."""


class MessageError(SprintlabError):
    """A message is damaged, of another kind, or holds values that no robot may act on."""


class JointMode(enum.IntEnum):
    """What the joints' drives do."""

    OFF = 0
    DAMPING = 1
    SERVO = 2


class RobotStatus(enum.IntFlag):
    """Conditions that the robot reports about itself."""

    READY = 0
    WATCHDOG_EXPIRED = 1
    DRIVE_FAULT = 2


class RobotState(msgspec.Struct, frozen=True, kw_only=True, eq=False, gc=False):
    """What the robot measures, published at 1 kHz."""

    sequence: int  # rises by one with every message
    timestamp: int  # robot's monotonic clock when measured [ns]
    joint_position: FloatArray  # motor encoders, joint side [rad] ``(joints,)``
    joint_velocity: FloatArray  # [rad/s] ``(joints,)``
    joint_torque: FloatArray  # estimated from the currents, joint side [N m] ``(joints,)``
    quaternion: FloatArray  # body to world, w, x, y, z ``(4,)``
    angular_velocity: FloatArray  # body frame [rad/s] ``(3,)``
    bus_voltage: float  # [V]
    command_sequence: int = 0  # number of the last accepted command; 0 before the first
    status: int = 0  # ``RobotStatus`` flags
    session: int = 0  # number of the controller that sent the last accepted command; 0 before the first


class JointCommand(msgspec.Struct, frozen=True, kw_only=True, eq=False, gc=False):
    """What the joints shall do until the next command, sent at 1 kHz."""

    sequence: int  # rises by one with every message; the first is 1
    timestamp: int  # controller's monotonic clock when sent [ns]
    mode: JointMode
    target_position: FloatArray  # [rad] ``(joints,)``
    stiffness: FloatArray  # [N m/rad] ``(joints,)``, not negative
    damping: FloatArray  # [N m s/rad] ``(joints,)``, not negative
    feedforward_torque: FloatArray  # joint side [N m] ``(joints,)``
    state_sequence: int = 0  # number of the newest state that had come
    session: int = 0  # the controller's number, drawn at random: it tells controllers apart


class PositionFix(msgspec.Struct, frozen=True, kw_only=True, eq=False, gc=False):
    """Where the robot is on the track (RTK-like receiver, or motion capture), typically at 10 Hz."""

    sequence: int  # rises by one with every message
    timestamp: int  # robot's monotonic clock [ns]
    position: FloatArray  # world frame [m] ``(3,)``
    velocity: FloatArray  # world frame [m/s] ``(3,)``


class ControlTick(msgspec.Struct, frozen=True, kw_only=True, eq=False, gc=False):
    """What happened in one 1 kHz step of the controller: what a log keeps."""

    time: float  # controller's clock since its start [s]
    mode: str  # name of the controller's mode
    state: RobotState | None  # the last accepted state; None before the first
    command: JointCommand  # the command that was sent
    velocity: FloatArray  # given to the policy: forward, sideways [m/s], yaw rate [rad/s] ``(3,)``
    targets: FloatArray  # joint targets before the guard [rad] ``(joints,)``
    policy_step: bool  # whether the policy ran in this step
    fix: PositionFix | None  # a position fix that came in this step
    faults: tuple[str, ...]  # names of faults noticed in this step
    compute_time: float  # from the wake-up to the command [s]


MessageType = TypeVar("MessageType", RobotState, JointCommand, PositionFix)

COMMAND_BOUNDS: dict[str, tuple[float, float]] = {
    "target_position": (-100.0, 100.0),
    "stiffness": (0.0, 1e5),
    "damping": (0.0, 1e4),
    "feedforward_torque": (-1e4, 1e4),
}
"""Least and greatest value of each field of a command [rad, N m/rad, N m s/rad, N m]: far beyond every robot,
and so small that no sum of their products overflows."""

_encoder = msgspec.msgpack.Encoder(enc_hook=lambda array: array.tobytes())
_decoders: dict[type, msgspec.msgpack.Decoder[Any]] = {
    kind: msgspec.msgpack.Decoder(kind, dec_hook=lambda _, content: np.frombuffer(content))
    for kind in (RobotState, JointCommand, PositionFix)
}
_CHECKSUM_SIZE = 4


def encode(message: RobotState | JointCommand | PositionFix) -> bytes:
    """The message's bytes. NaN passes unchanged."""
    body = _encoder.encode(message)
    return body + zlib.crc32(body).to_bytes(_CHECKSUM_SIZE, "little")


def decode(kind: type[MessageType], data: bytes) -> MessageType:
    """A message of type ``kind`` from its bytes; a state with NaN decodes, for the monitors to count.

    Raises:
        MessageError: a checksum that does not fit, another kind of message, an unknown mode.
    """
    body = data[:-_CHECKSUM_SIZE]
    if zlib.crc32(body) != int.from_bytes(data[-_CHECKSUM_SIZE:], "little"):
        raise MessageError(f"a {kind.__name__} came damaged: its checksum does not fit")
    try:
        return _decoders[kind].decode(body)
    except (msgspec.DecodeError, ValueError) as error:
        raise MessageError(f"not a {kind.__name__}: {error}") from error


def check_command(command: JointCommand, joints: int) -> None:
    """Refuse a command that no robot with so many joints may act on.

    Raises:
        MessageError: not one number per joint, or one that is not finite or outside ``COMMAND_BOUNDS``.
    """
    for field, (least, greatest) in COMMAND_BOUNDS.items():
        value = getattr(command, field)
        numbers = value.tolist()  # Python finds the extremes of a dozen numbers sooner than NumPy
        finite = not math.isnan(sum(numbers))  # the extremes may pass over NaN
        if not (value.shape == (joints,) and finite and least <= min(numbers) and max(numbers) <= greatest):
            raise MessageError(f"{field} is not {joints} numbers from {least:g} to {greatest:g}")
