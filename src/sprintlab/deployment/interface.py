"""What a controller and a robot say to each other: message types and their bytes.

Every message has one fixed little-endian layout: a header (magic ``SPRT``, format version, kind, sequence,
timestamp), whole numbers, doubles, and the CRC-32 of all before it. Joints are in policy order, SI units;
the length of a message tells how many a robot has.

Clocks: a ``timestamp`` is nanoseconds of the *sender's* monotonic clock. It orders messages of one sender
and is never compared with the receiver's clock; age is counted by the receiver from arrival. (On one machine
both read the same clock, so that logs can show latencies.)

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
import secrets
import struct
import zlib
from typing import Any, Protocol, TypeVar

import msgspec
import numpy as np
import numpy.typing as npt

from sprintlab.core.errors import SprintlabError

FloatArray = npt.NDArray[np.float64]

FORMAT_VERSION = 4
MAGIC = b"SPRT"
MOST_JOINTS = 32
"""Joints that a message has room for."""
WATCHDOG_TIMEOUT = 0.05
"""Seconds without an accepted command after which the robot damps its joints by itself."""


class MessageError(SprintlabError):
    """A message that is damaged, of another kind or version, or holds values that no robot may act on."""


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


class Request(enum.IntEnum):
    """What an operator asks of the controller's state machine."""

    NONE = 0
    PASSIVE = 1
    STAND = 2
    RUN = 3
    LIE_DOWN = 4
    STOP = 5


class RobotState(msgspec.Struct, frozen=True, kw_only=True, eq=False, gc=False):
    """What the robot measures, published at 1 kHz.

    Attributes:
        sequence: rises by one with every message.
        timestamp: robot's monotonic clock when measured [ns].
        joint_position: motor encoders, joint side [rad] ``(joints,)``.
        joint_velocity: [rad/s] ``(joints,)``.
        joint_torque: estimated from the currents, joint side [N m] ``(joints,)``.
        quaternion: body to world, w, x, y, z ``(4,)``.
        angular_velocity: body frame [rad/s] ``(3,)``.
        bus_voltage: [V].
        command_sequence: number of the last accepted command; 0 before the first.
        status: ``RobotStatus`` flags.
        session: number of the controller that sent the last accepted command; 0 before the first.
    """

    sequence: int
    timestamp: int
    joint_position: FloatArray
    joint_velocity: FloatArray
    joint_torque: FloatArray
    quaternion: FloatArray
    angular_velocity: FloatArray
    bus_voltage: float
    command_sequence: int = 0
    status: int = 0
    session: int = 0


class JointCommand(msgspec.Struct, frozen=True, kw_only=True, eq=False, gc=False):
    """What the joints shall do until the next command, sent at 1 kHz.

    Attributes:
        sequence: rises by one with every message; the first is 1.
        timestamp: controller's monotonic clock when sent [ns].
        mode: ``JointMode``.
        target_position: [rad] ``(joints,)``.
        stiffness: [N m/rad] ``(joints,)``, not negative.
        damping: [N m s/rad] ``(joints,)``, not negative.
        feedforward_torque: joint side [N m] ``(joints,)``.
        state_sequence: number of the state that the command answers.
        session: the controller's number, drawn once at random, 64 bits. It tells controllers apart;
            it is no secret.
    """

    sequence: int
    timestamp: int
    mode: JointMode
    target_position: FloatArray
    stiffness: FloatArray
    damping: FloatArray
    feedforward_torque: FloatArray
    state_sequence: int = 0
    session: int = 0


class PositionFix(msgspec.Struct, frozen=True, kw_only=True, eq=False, gc=False):
    """Where the robot is on the track (RTK-like receiver, or motion capture), typically at 10 Hz.

    Attributes:
        sequence: rises by one with every message.
        timestamp: robot's monotonic clock [ns].
        position: world frame [m] ``(3,)``.
        velocity: world frame [m/s] ``(3,)``.
    """

    sequence: int
    timestamp: int
    position: FloatArray
    velocity: FloatArray


class OperatorCommand(msgspec.Struct, frozen=True, kw_only=True, eq=False, gc=False):
    """What a command source wants.

    Attributes:
        sequence: rises by one whenever the source is alive; a frozen sequence counts as a lost source.
        timestamp: the source's monotonic clock [ns].
        velocity: forward, sideways speed [m/s], yaw rate [rad/s] ``(3,)``.
        request: ``Request``; obeyed as soon as the robot is fit for it, while the source repeats it.
    """

    sequence: int
    timestamp: int
    velocity: FloatArray
    request: Request = Request.NONE


Message = RobotState | JointCommand | PositionFix
MessageType = TypeVar("MessageType", RobotState, JointCommand, PositionFix)

COMMAND_BOUNDS: dict[str, tuple[float, float]] = {
    "target_position": (-100.0, 100.0),
    "stiffness": (0.0, 1e5),
    "damping": (0.0, 1e4),
    "feedforward_torque": (-1e4, 1e4),
}
"""Least and greatest value of each field of a command [rad, N m/rad, N m s/rad, N m]: far beyond every robot,
and so small that no sum of their products overflows."""

_HEADER = "<4sHHQQ"
_HEADER_FIELDS = 5
_SCALAR, _PER_JOINT = 0, -1  # sizes of fields that are no arrays, or arrays with a number per joint


class _Layout:
    """The bytes of one kind of message: header, whole numbers, doubles, checksum."""

    def __init__(self, kind: int, type_: type, whole: dict[str, type], doubles: dict[str, int]) -> None:
        self.kind, self.type, self.whole, self.doubles = kind, type_, whole, doubles
        self.head = struct.Struct(_HEADER + "Q" * len(whole))
        sizes = list(doubles.values())
        fixed = sum(max(size, 1) for size in sizes if size != _PER_JOINT)
        self.fixed_size = self.head.size + 8 * fixed + 4
        self.joint_size = 8 * sizes.count(_PER_JOINT)

    def size(self, joints: int) -> int:
        """Bytes of a message of a robot with so many joints."""
        return self.fixed_size + joints * self.joint_size

    def joints(self, size: int) -> int | None:
        """Joints of the robot whose messages have ``size`` bytes; None where no message has."""
        if not self.joint_size:
            return 0 if size == self.fixed_size else None
        joints, rest = divmod(size - self.fixed_size, self.joint_size)
        return joints if rest == 0 and 1 <= joints <= MOST_JOINTS else None

    def pack(self, message: Any) -> bytes:
        numbers: list[float] = []
        for field, size in self.doubles.items():
            value = getattr(message, field)
            if size == _SCALAR:
                numbers.append(value)
            else:
                numbers.extend(value.tolist())
        whole = [int(getattr(message, field)) for field in self.whole]
        head = self.head.pack(MAGIC, FORMAT_VERSION, self.kind, message.sequence, message.timestamp, *whole)
        body = head + struct.pack(f"<{len(numbers)}d", *numbers)
        return body + zlib.crc32(body).to_bytes(4, "little")

    def unpack(self, data: bytes, joints: int) -> Any:
        head = self.head.unpack_from(data)
        fields: dict[str, Any] = {"sequence": head[3], "timestamp": head[4]}
        for (field, type_), value in zip(self.whole.items(), head[_HEADER_FIELDS:], strict=True):
            fields[field] = type_(value)
        numbers = np.frombuffer(data[:-4], "<f8", offset=self.head.size).astype(np.float64)
        start = 0
        for field, size in self.doubles.items():
            length = joints if size == _PER_JOINT else size
            fields[field] = float(numbers[start]) if size == _SCALAR else numbers[start : start + length]
            start += max(length, 1)
        return self.type(**fields)


_LAYOUTS = (
    _Layout(
        1,
        RobotState,
        {"command_sequence": int, "status": int, "session": int},
        {
            "joint_position": _PER_JOINT,
            "joint_velocity": _PER_JOINT,
            "joint_torque": _PER_JOINT,
            "quaternion": 4,
            "angular_velocity": 3,
            "bus_voltage": _SCALAR,
        },
    ),
    _Layout(
        2,
        JointCommand,
        {"mode": JointMode, "state_sequence": int, "session": int},
        dict.fromkeys(COMMAND_BOUNDS, _PER_JOINT),
    ),
    _Layout(3, PositionFix, {}, {"position": 3, "velocity": 3}),
)
_BY_TYPE = {layout.type: layout for layout in _LAYOUTS}


def message_size(kind: type[Message], joints: int = MOST_JOINTS) -> int:
    """Bytes of a message of this type, of a robot with so many joints."""
    return _BY_TYPE[kind].size(joints)


def encode(message: Message) -> bytes:
    """The message's bytes, as many as ``message_size`` says. NaN passes unchanged."""
    return _BY_TYPE[type(message)].pack(message)


def decode(kind: type[MessageType], data: bytes | bytearray | memoryview) -> MessageType:
    """A message of type ``kind`` from its bytes.

    Values are not judged here: a state with NaN decodes, so that the safety layer sees and counts it.

    Raises:
        MessageError: wrong length, magic, version or kind, a checksum that does not fit, an unknown mode.
    """
    layout, content = _BY_TYPE[kind], bytes(data)
    joints = layout.joints(len(content))
    if joints is None:
        raise MessageError(f"a {kind.__name__} cannot have {len(content)} bytes")
    magic, version, number = struct.unpack_from("<4sHH", content)
    if (magic, version, number) != (MAGIC, FORMAT_VERSION, layout.kind):
        raise MessageError(
            f"not a {kind.__name__} of version {FORMAT_VERSION}: {magic!r}, {version}, {number}"
        )
    if zlib.crc32(content[:-4]) != int.from_bytes(content[-4:], "little"):
        raise MessageError(f"a {kind.__name__} came damaged: its checksum does not fit")
    try:
        return layout.unpack(content, joints)
    except ValueError as error:
        raise MessageError(f"a {kind.__name__} holds a value that is not defined: {error}") from error


def new_session() -> int:
    """A random number that tells one controller from every other, 1 to 2**64 - 1."""
    return secrets.randbelow(2**64 - 1) + 1


def within_bounds(field: str, value: FloatArray) -> bool:
    """Whether all numbers of a command's field are within ``COMMAND_BOUNDS``; NaN is not."""
    least, greatest = COMMAND_BOUNDS[field]
    numbers = value.tolist()  # of a dozen numbers Python finds the extremes sooner than NumPy
    if math.isnan(sum(numbers)):  # which the extremes may pass over
        return False
    return not numbers or (least <= min(numbers) and max(numbers) <= greatest)


def check_command(command: JointCommand, joints: int) -> None:
    """Refuse a command that no robot with so many joints may act on.

    Raises:
        MessageError: not one number per joint, or one that is not finite or outside ``COMMAND_BOUNDS``.
    """
    for field, (least, greatest) in COMMAND_BOUNDS.items():
        value = getattr(command, field)
        if value.shape != (joints,) or not within_bounds(field, value):
            raise MessageError(f"{field} is not {joints} numbers from {least:g} to {greatest:g}")


class SourceView(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """What the controller tells a command source at each policy step.

    Attributes:
        time: controller's clock since its start [s].
        running_time: since the policy took over [s]; None unless in ``run``.
        mode: name of the controller's mode (``passive``, ``stand-up``, ``stand``, ``run``, ``lie-down``,
            ``stop``).
        state: the last accepted state.
        fix: the last position fix, if the robot has a receiver.
        heading: yaw relative to the heading at the start of ``run`` [rad].
        lateral_offset: to the left of the line along which ``run`` started [m]; 0 without fixes.
        forward_speed: along that line's heading [m/s]; None without fixes.
    """

    time: float
    running_time: float | None
    mode: str
    state: RobotState
    fix: PositionFix | None
    heading: float
    lateral_offset: float
    forward_speed: float | None


class CommandSource(Protocol):
    """Where the commanded velocity comes from; read at 50 Hz in the control thread, so it never blocks."""

    def read(self, view: SourceView) -> OperatorCommand | None:
        """The source's present wish; None if it has nothing (counted as silence)."""
        ...

    def close(self) -> None:
        """Let go of devices; a second call does nothing."""
        ...


class ControlTick(msgspec.Struct, frozen=True, kw_only=True, eq=False, gc=False):
    """What happened in one 1 kHz step of the controller: what a log keeps.

    Attributes:
        time: controller's clock since its start [s].
        mode: name of the controller's mode, see ``SourceView.mode``.
        state: the last accepted state; None before the first.
        command: the command that was sent.
        velocity: commanded velocity that the policy was given: forward, sideways [m/s], yaw rate [rad/s]
            ``(3,)``.
        targets: joint targets before the safety layer [rad] ``(joints,)``.
        policy_step: whether the policy ran in this step.
        fix: a position fix that came in this step.
        faults: names of faults noticed in this step.
        compute_time: from the wake-up to the command [s].
    """

    time: float
    mode: str
    state: RobotState | None
    command: JointCommand
    velocity: FloatArray
    targets: FloatArray
    policy_step: bool
    fix: PositionFix | None
    faults: tuple[str, ...]
    compute_time: float


class RunLog(Protocol):
    """Where the control thread puts its ticks; ``write`` never waits for a disk."""

    def write(self, tick: ControlTick) -> None:
        """Keep one tick."""
        ...

    def close(self) -> None:
        """Finish the file; a second call does nothing."""
        ...
