"""Reading a log file back as arrays.

Messages stay the bytes that they are until somebody asks for a field: an hour of them takes some four
gigabytes, and no longer than to unpack it.
"""

from __future__ import annotations

import os
import struct
import zlib
from array import array
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Generic, TypeVar, cast, overload

import msgspec
import numpy as np
from numpy.typing import NDArray

from sprintlab.core.errors import printable
from sprintlab.core.extras import require_package
from sprintlab.core.reading import open_regular
from sprintlab.deployment.interface import (
    JointCommand,
    JointMode,
    MessageError,
    PositionFix,
    RobotState,
    decode,
    message_layout,
    message_size,
    message_start,
)
from sprintlab.deployment.log.topics import (
    COMMAND,
    CONTRACT_NAME,
    END_NAME,
    FACTS_NAME,
    FIX,
    MAGIC,
    STATE,
    TICK,
    LogError,
    TickRecord,
)

FloatArray = NDArray[np.float64]
Message = TypeVar("Message", RobotState, JointCommand, PositionFix)

LOG_LIMIT = 4 << 30
"""Largest log that is read [bytes]."""
UNPACKED_LIMIT = 8 << 30
"""Most bytes to which the chunks of a log may unpack."""
MOST_MESSAGES = 3_700_000
"""Most messages of one kind: an hour at 1 kHz."""
LONGEST_RUN = 3700.0
"""Longest log that is read [s]."""

_MOST_OTHERS = 1_000_000  # records that are no states, fixes, commands or control steps, and facts
_CHUNK_WORK = 10  # records that are looked at in the time in which a chunk is unpacked
_LARGEST_WINDOW = 64 << 20
_LARGEST_CHUNK = 64 << 20
_LARGEST_NOTE = 4 << 20  # facts, contract
_TICK_FIELDS = len(TickRecord.__struct_fields__)
_MOST_NAMES = 1000  # of facts, of modes, of faults
_MOST_FAULTS = 8 * MOST_MESSAGES  # in all control steps
_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _ATTACHMENT, _METADATA = 3, 4, 5, 6, 9, 12
_RECORD, _MESSAGE_HEAD = struct.Struct("<BQ"), struct.Struct("<HIQQ")
_DATA_END = struct.Struct("<BQI")  # kind, length, checksum of all before
_FOOTER = struct.Struct("<BQQQI")  # kind, length, where the summary begins, its offsets, its checksum
_DATA_END_HEAD = _RECORD.pack(15, 4)
_BLOCK = 1 << 20  # bytes that are read at once where nothing is taken apart
_NOTES = {_CHANNEL, _ATTACHMENT, _METADATA}
_IN_CHUNKS = {_SCHEMA, _CHANNEL, _MESSAGE}
_LARGEST = 1e9  # of any number, in its SI unit
_NUMBERS = (
    *(("states", name) for name in ("joint_position", "joint_velocity", "joint_torque", "bus_voltage")),
    *(("states", name) for name in ("quaternion", "angular_velocity")),
    *(("fixes", name) for name in ("position", "velocity")),
    *(("ticks", name) for name in ("velocity", "targets", "compute_time")),
)


class Messages(Sequence[Message], Generic[Message]):
    """Messages of one kind, kept as the bus's bytes.

    Attributes:
        joints: of the robot that they are of; 0 where a message holds none.
    """

    def __init__(self, kind: type[Message]) -> None:
        self._kind, self._start = kind, message_start(kind)
        self._size, self.joints = 0, 0
        self._content, self._times = bytearray(), array("Q")

    def add(self, time: int, content: bytes) -> None:
        """Keep one message.

        Raises:
            MessageError: it is damaged, of another version, or of a robot with other joints than the first.
        """
        sound = len(content) == self._size and content.startswith(self._start)
        if not sound or zlib.crc32(content[:-4]) != int.from_bytes(content[-4:], "little"):
            self._begin(content)
        self._content += content
        self._times.append(time)

    def _begin(self, content: bytes) -> None:
        """Take the number of joints from the first message; refuse any other that differs."""
        decode(self._kind, content)
        if len(self):
            raise MessageError("its messages do not all have the same number of joints")
        self._size = len(content)
        none, one = (message_size(self._kind, joints) for joints in (0, 1))
        self.joints = (self._size - none) // (one - none) if one > none else 0

    @property
    def time(self) -> FloatArray:
        """When each message was noted [s] ``(n,)``."""
        return np.frombuffer(self._times, dtype=np.uint64).astype(np.float64) * 1e-9

    def column(self, field: str) -> NDArray[Any]:
        """One field of all messages ``(n,)`` or ``(n, k)``."""
        return np.frombuffer(self._content, dtype=message_layout(self._kind, self.joints))[field]

    def __len__(self) -> int:
        return len(self._times)

    @overload
    def __getitem__(self, index: int) -> Message: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[Message]: ...
    def __getitem__(self, index: int | slice) -> Message | Sequence[Message]:
        if isinstance(index, slice):
            return [self[place] for place in range(*index.indices(len(self)))]
        start = range(len(self))[index] * self._size
        return decode(self._kind, bytes(self._content[start : start + self._size]))


class Ticks(Sequence[TickRecord]):
    """What the controller noted of its steps, as columns.

    Attributes:
        joints: that have targets.
        faults: of the steps that had some, by their number.
    """

    def __init__(self) -> None:
        self._decoder = msgspec.json.Decoder(TickRecord)
        self._numbers = array("d")
        self._modes, self._names = array("H"), dict[str, int]()
        self._fault_names, self._fault_count = dict[str, str](), 0
        self._policy_steps = bytearray()
        self.joints = 0
        self.faults: dict[int, tuple[str, ...]] = {}

    def add(self, time: int, content: bytes) -> None:
        """Keep one step, which holds its time itself. Raises ``msgspec.DecodeError`` or ``LogError``."""
        del time
        if content.count(b":") > _TICK_FIELDS:  # before it is decoded: fields may be many, or there twice
            raise LogError("a control step holds more than its fields, or one of them twice")
        tick = self._decoder.decode(content)
        self.joints = self.joints or len(tick.targets)
        if len(tick.velocity) != 3 or len(tick.targets) != self.joints:
            raise LogError(
                f"a control step has {len(tick.velocity)} velocities and {len(tick.targets)} targets"
            )
        if tick.faults:
            self._add_faults(tick.faults)
        if tick.mode not in self._names and len(self._names) == _MOST_NAMES:
            raise LogError(f"its control steps have more than {_MOST_NAMES} modes")
        self._modes.append(self._names.setdefault(tick.mode, len(self._names)))
        self._policy_steps.append(tick.policy_step)
        self._numbers.extend((tick.time, *tick.velocity, *tick.targets, tick.compute_time))

    def _add_faults(self, names: tuple[str, ...]) -> None:
        """Keep the faults of a step, each name in one place."""
        known = self._fault_names
        self.faults[len(self)] = tuple(known.setdefault(name, printable(name)) for name in names)
        self._fault_count += len(names)
        if len(known) > _MOST_NAMES or self._fault_count > _MOST_FAULTS:
            raise LogError(f"its control steps have more than {_MOST_NAMES} kinds of faults, or too many")

    def column(self, field: str) -> NDArray[Any]:
        """One field of all steps: ``(n,)``, ``(n, 3)`` or ``(n, joints)``; of ``mode`` the names."""
        if field == "mode":
            return np.array(list(self._names))[np.frombuffer(self._modes, dtype=np.uint16)]
        if field == "policy_step":
            return np.frombuffer(self._policy_steps, dtype=bool)
        table = np.frombuffer(self._numbers).reshape(-1, 5 + self.joints)
        places = {"time": 0, "velocity": slice(1, 4), "targets": slice(4, -1), "compute_time": -1}
        return table[:, places[field]]

    def __len__(self) -> int:
        return len(self._modes)

    @overload
    def __getitem__(self, index: int) -> TickRecord: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[TickRecord]: ...
    def __getitem__(self, index: int | slice) -> TickRecord | Sequence[TickRecord]:
        if isinstance(index, slice):
            return [self[place] for place in range(*index.indices(len(self)))]
        place = range(len(self))[index]
        return TickRecord(
            time=float(self.column("time")[place]),
            mode=list(self._names)[self._modes[place]],
            velocity=tuple(self.column("velocity")[place].tolist()),
            targets=tuple(self.column("targets")[place].tolist()),
            policy_step=bool(self._policy_steps[place]),
            faults=self.faults.get(place, ()),
            compute_time=float(self.column("compute_time")[place]),
        )


@dataclass(frozen=True, kw_only=True)
class RunRecord:
    """A log in memory. Times are of the controller's clock [s].

    Attributes:
        facts: what the log says of its run; ``robot`` is always there, ``ticks dropped`` unless the
            controller did not come to its end.
        contract: the policy's contract, JSON.
        states: the accepted states; their time is when each was accepted.
        commands: what was sent.
        fixes: the position fixes.
        ticks: what else the controller noted, one a command.
    """

    facts: dict[str, str]
    contract: str
    states: Messages[RobotState]
    commands: Messages[JointCommand]
    fixes: Messages[PositionFix]
    ticks: Ticks

    @property
    def state_time(self) -> FloatArray:
        """When each state was accepted ``(S,)``."""
        return self.states.time

    @property
    def command_time(self) -> FloatArray:
        """When each command was sent ``(C,)``."""
        return self.commands.time

    @property
    def fix_time(self) -> FloatArray:
        """When each position fix came ``(F,)``."""
        return self.fixes.time

    def column(self, topic: str, field: str) -> NDArray[Any]:
        """One field of every message of ``"states"``, ``"commands"``, ``"fixes"`` or ``"ticks"``.

        Returns:
            ``(messages,)`` or ``(messages, n)``.
        """
        return getattr(self, topic).column(field)


def read_log(path: Path) -> RunRecord:
    """Read a log file; one that was cut off is read up to the cut.

    Raises:
        LogError: there is no such file, it is no log of sprintlab, it is damaged, larger or longer than what
            is read, or the package ``zstandard`` is missing.
    """
    require_package("zstandard", extra="log", use="reading a log")
    reader = _Reader()
    try:
        with open_regular(path, LOG_LIMIT, what="log", error=LogError) as file:
            _check_whole(file)
            reader.read(file)
        record = reader.record()
        run = len(record.states) and len(record.ticks)
        wrong = _impossible(record) if run else ""
    except (LogError, MessageError, msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise LogError(f"{printable(path)} is damaged or no log of sprintlab: {printable(error)}") from error
    if not run:
        raise LogError(f"{printable(path)} holds no run: no state or no control step was logged")
    if wrong:
        raise LogError(f"{printable(path)} is damaged: {wrong}")
    return record


def _check_whole(file: IO[bytes]) -> None:
    """Refuse a complete file in which a bit is another one; then it is at its beginning again.

    The checksums of its parts do not cover their kinds and lengths: a part that is no longer taken for one
    would be missing without a word. Of a file that was cut off nobody knows what belongs to it.

    Raises:
        LogError: its checksum does not fit.
    """
    size = file.seek(0, os.SEEK_END)
    file.seek(max(size - _FOOTER.size - len(MAGIC), 0))
    tail = file.read()
    if len(tail) == _FOOTER.size + len(MAGIC) and tail.endswith(MAGIC):
        end = _FOOTER.unpack_from(tail)[2] - _DATA_END.size
        if not (0 <= end < size and _fits(file, end)):
            raise LogError("its checksum does not fit; take an earlier copy")
    file.seek(0)


def _fits(file: IO[bytes], end: int) -> bool:
    """Whether the data end at ``end`` [bytes], with the checksum of all before; older logs have none."""
    file.seek(end)
    last = file.read(_DATA_END.size)
    if not last.startswith(_DATA_END_HEAD) or len(last) < _DATA_END.size:
        return False
    told, found = _DATA_END.unpack(last)[2], 0
    file.seek(0)
    for begin in range(0, end if told else 0, _BLOCK):
        found = zlib.crc32(file.read(min(_BLOCK, end - begin)), found)
    return found == told


def _impossible(record: RunRecord) -> str:
    """What no run can have logged; empty where there is nothing of the kind."""
    joints = {record.states.joints, record.ticks.joints, record.commands.joints or record.states.joints}
    if len(joints) > 1:
        return "its messages do not all have the same number of joints"
    times = {
        "states": record.state_time,
        "fixes": record.fix_time,
        "control steps": record.ticks.column("time"),
    }
    for name, time in times.items():
        if not np.isfinite(time).all() or (np.diff(time) < 0.0).any():
            return f"the times of its {name} do not rise"
        if len(time) and not time[-1] - time[0] <= LONGEST_RUN:
            return f"its {name} span more than {LONGEST_RUN:g} s"
    for topic, field in _NUMBERS:
        values = record.column(topic, field)
        if not np.isfinite(values).all() or np.abs(values).max(initial=0.0) > _LARGEST:
            return f"{field} holds what no robot measures"
    if (np.linalg.norm(record.column("states", "quaternion"), axis=1) < 0.5).any():
        return "an orientation is no unit quaternion"
    if (record.column("commands", "mode") > max(JointMode)).any():
        return "a command has an unknown mode"
    return ""


class _Reader:
    """Takes an MCAP file apart, record by record, within bounds: https://mcap.dev/spec."""

    def __init__(self) -> None:
        self._states = Messages(RobotState)
        self._commands = Messages(JointCommand)
        self._fixes = Messages(PositionFix)
        self._ticks = Ticks()
        self._stores: dict[str, Messages[Any] | Ticks] = {
            STATE: self._states, COMMAND: self._commands, FIX: self._fixes, TICK: self._ticks,
        }  # fmt: skip
        self._channels: dict[int, Messages[Any] | Ticks] = {}
        self._facts: dict[str, str] = {}
        self._contract = ""
        self._others, self._room = 0, UNPACKED_LIMIT

    def record(self) -> RunRecord:
        """What was read. Raises ``LogError`` where that is no run."""
        if "robot" not in self._facts:
            raise LogError("it says nothing of a robot")
        return RunRecord(
            facts=self._facts,
            contract=self._contract,
            states=self._states,
            commands=self._commands,
            fixes=self._fixes,
            ticks=self._ticks,
        )

    def read(self, file: IO[bytes]) -> None:
        """Every record of a file, up to where it is cut off."""
        if file.read(len(MAGIC)) != MAGIC:
            raise LogError("it does not begin as an MCAP file")
        while len(head := file.read(_RECORD.size)) == _RECORD.size:
            kind, length = _RECORD.unpack(head)
            if kind in (_CHUNK, _MESSAGE, *_NOTES):
                limit = 2 * _LARGEST_CHUNK if kind == _CHUNK else _LARGEST_NOTE
                content = file.read(min(length, limit + 1))
                if len(content) > limit:
                    raise LogError(f"a record has more than {limit >> 20} MB")
                if len(content) < length:
                    return
                self._take(kind, content)
            elif length >= 1 << 63:
                return
            else:
                self._count_other()
                file.seek(length, 1)

    def _count_other(self, work: int = 1) -> None:
        self._others += work
        if self._others > _MOST_OTHERS:
            raise LogError(f"it holds more than {_MOST_OTHERS} records of no use")

    def _take(self, kind: int, content: bytes) -> None:
        try:
            if kind == _CHUNK:
                self._take_chunk(content)
            elif kind == _MESSAGE:
                self._take_message(content, 0, len(content))
            else:
                self._take_note(kind, content)
        except struct.error:
            raise LogError("a record is shorter than its kind") from None

    def _take_chunk(self, content: bytes) -> None:
        """The records of a chunk, which holds them whole."""
        self._count_other(_CHUNK_WORK)
        data = self._unpacked(content)
        self._room -= len(data)
        at, end, head = 0, len(data), _RECORD.unpack_from
        while at < end:
            kind, length = head(data, at)
            begin = at + _RECORD.size
            at = begin + length
            if kind not in _IN_CHUNKS or at > end:
                raise LogError("a chunk holds a record of an unknown kind, or a part of one")
            if kind == _MESSAGE:
                self._take_message(data, begin, at)
            elif kind == _CHANNEL:
                self._take_note(kind, data[begin:at])
            else:
                self._count_other()

    def _unpacked(self, content: bytes) -> bytes:
        """A chunk's records; never unpacks more than there is room for."""
        _, _, _, checksum, length = struct.unpack_from("<QQQII", content)
        compression = content[32 : 32 + length]
        packed = content[32 + length + 8 :]
        limit = min(self._room, _LARGEST_CHUNK)
        data = packed if compression == b"" else _unpacked(compression, packed, limit)
        if len(data) > limit:
            raise LogError(
                f"it, or a chunk of it, unpacks to more than {UNPACKED_LIMIT >> 20} or "
                f"{_LARGEST_CHUNK >> 20} MB, the most that is read"
            )
        if checksum and zlib.crc32(data) != checksum:
            raise LogError("the checksum of a chunk does not fit")
        return data

    def _take_message(self, data: bytes, begin: int, end: int) -> None:
        channel, _, time, _ = _MESSAGE_HEAD.unpack_from(data, begin)
        store = self._channels.get(channel)
        if store is None:
            self._count_other()
            return
        store.add(time, data[begin + _MESSAGE_HEAD.size : end])
        if len(store) > MOST_MESSAGES:
            raise LogError(f"it holds more than {MOST_MESSAGES} messages of one kind, an hour at 1 kHz")

    def _take_note(self, kind: int, content: bytes) -> None:
        self._count_other()
        if kind == _CHANNEL:
            (number,) = struct.unpack_from("<H", content)
            topic, _ = _text(content, 4)
            self._channels.pop(number, None)
            if topic in self._stores:
                self._channels[number] = self._stores[topic]
        elif kind == _ATTACHMENT:
            name, at = _text(content, 16)
            _, at = _text(content, at)
            if name == CONTRACT_NAME:
                if self._contract:
                    raise LogError("it holds two contracts")
                self._contract = content[at + 8 : at + 8 + struct.unpack_from("<Q", content, at)[0]].decode()
        else:
            name, at = _text(content, 0)
            end = at + 4 + struct.unpack_from("<I", content, at)[0]
            at += 4
            while name in (FACTS_NAME, END_NAME) and at < end:
                key, at = _text(content, at)
                value, at = _text(content, at)
                self._count_other()
                if (fact := printable(key, 100)) in self._facts:
                    raise LogError(f"it says twice what its {fact} was")
                self._facts[fact] = printable(value)
                if len(self._facts) > _MOST_NAMES:
                    raise LogError(f"it says more than {_MOST_NAMES} facts of its run")


def _text(content: bytes, at: int) -> tuple[str, int]:
    """A text with its length before it, and where it ends."""
    (length,) = struct.unpack_from("<I", content, at)
    if at + 4 + length > len(content):
        raise LogError("a text is longer than its record")
    return content[at + 4 : at + 4 + length].decode(), at + 4 + length


def _unpacked(compression: bytes, packed: bytes, limit: int) -> bytes:
    if compression != b"zstd":
        named = printable(compression.decode(errors="replace"), 20)
        raise LogError(f"a log of sprintlab is packed with zstd, not with {named}")
    import zstandard

    unpacker = zstandard.ZstdDecompressor(max_window_size=_LARGEST_WINDOW)
    try:
        with unpacker.stream_reader(packed) as stream:
            return cast("bytes", stream.read(limit + 1))
    except (zstandard.ZstdError, MemoryError) as error:
        raise LogError("a chunk cannot be unpacked") from error
