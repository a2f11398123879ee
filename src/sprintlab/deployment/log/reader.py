"""Reading a log file back as arrays."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from sprintlab.core.errors import SprintlabError
from sprintlab.core.reading import printable, read_bytes
from sprintlab.deployment.interface import (
    JointCommand,
    MessageError,
    PositionFix,
    RobotState,
    decode,
)
from sprintlab.deployment.log.schemas import MESSAGE_TYPES
from sprintlab.deployment.log.topics import (
    COMMAND,
    CONTRACT_NAME,
    END_NAME,
    FACTS_NAME,
    FIX,
    STATE,
    TICK,
    LogError,
    TickRecord,
)

FloatArray = NDArray[np.float64]

LOG_LIMIT = 1 << 30
"""Largest log that is read [bytes]."""
UNPACKED_LIMIT = 2 << 30
"""Most bytes to which the chunks of a log may unpack."""
MOST_MESSAGES = 500_000
"""Most messages of one kind: eight minutes at 1 kHz; all kinds together have four times as many."""
LONGEST_RUN = 3600.0
"""Longest log that is read [s]."""

_LARGEST_WINDOW = 64 << 20
_LARGEST_CHUNK = 64 << 20
_CHUNK_RECORDS = {3, 4, 5}  # schema, channel, message
_LARGEST = 1e9  # of any number, in its SI unit
_NUMBERS = (
    *(("states", name) for name in ("joint_position", "joint_velocity", "joint_torque", "bus_voltage")),
    *(("states", name) for name in ("quaternion", "angular_velocity")),
    *(("fixes", name) for name in ("position", "velocity")),
    *(("ticks", name) for name in ("velocity", "targets", "compute_time")),
)


@dataclass(frozen=True, kw_only=True)
class RunRecord:
    """A log in memory. Times are of the controller's clock [s].

    Attributes:
        facts: what the log says of its run; ``robot`` is always there, ``ticks dropped`` unless the
            controller did not come to its end.
        contract: the policy's contract, JSON.
        state_time: ``(S,)`` when each state was accepted.
        states: the accepted states.
        command_time: ``(C,)`` when each command was sent.
        commands: what was sent.
        fix_time: ``(F,)`` when each position fix came.
        fixes: the position fixes.
        ticks: what else the controller noted, one a command.
    """

    facts: dict[str, str]
    contract: str
    state_time: FloatArray
    states: tuple[RobotState, ...]
    command_time: FloatArray
    commands: tuple[JointCommand, ...]
    fix_time: FloatArray
    fixes: tuple[PositionFix, ...]
    ticks: tuple[TickRecord, ...]

    def column(self, topic: str, field: str) -> FloatArray:
        """One field of every message of ``"states"``, ``"commands"``, ``"fixes"`` or ``"ticks"``.

        Returns:
            ``(messages,)`` or ``(messages, n)``.
        """
        return np.array([getattr(message, field) for message in getattr(self, topic)])


def read_log(path: Path) -> RunRecord:
    """Read a log file; one that was cut off is read up to the cut.

    Raises:
        LogError: there is no such file, it is no log of sprintlab, it is damaged, larger or longer than what
            is read, or the package ``mcap`` is missing.
    """
    found: dict[str, list[tuple[float, Any]]] = {STATE: [], COMMAND: [], FIX: [], TICK: []}
    try:
        facts, contract = _read_into(path, found)
    except (MessageError, msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise LogError(f"{printable(path)} is damaged: {printable(error)}") from error
    if not found[STATE] or not found[TICK]:
        raise LogError(f"{printable(path)} holds no run: no state or no control step was logged")
    state_time, states = _columns(found[STATE])
    command_time, commands = _columns(found[COMMAND])
    fix_time, fixes = _columns(found[FIX])
    record = RunRecord(
        facts=facts,
        contract=contract,
        state_time=state_time,
        states=states,
        command_time=command_time,
        commands=commands,
        fix_time=fix_time,
        fixes=fixes,
        ticks=_columns(found[TICK])[1],
    )
    wrong = _impossible(record)
    if wrong:
        raise LogError(f"{printable(path)} is damaged: {wrong}")
    return record


def _impossible(record: RunRecord) -> str:
    """What no run can have logged; empty where there is nothing of the kind."""
    ticks = np.array([tick.time for tick in record.ticks])
    for name, time in (("states", record.state_time), ("fixes", record.fix_time), ("control steps", ticks)):
        if not np.isfinite(time).all() or (np.diff(time) < 0.0).any():
            return f"the times of its {name} do not rise"
        if len(time) and not time[-1] - time[0] <= LONGEST_RUN:
            return f"its {name} span more than {LONGEST_RUN:g} s"
    joints = len(record.states[0].joint_position)
    if any(len(state.joint_position) != joints for state in record.states) or any(
        len(command.target_position) != joints for command in record.commands
    ):
        return "its messages do not all have the same number of joints"
    for tick in record.ticks:
        if len(tick.velocity) != 3 or len(tick.targets) != joints:
            return f"a control step has {len(tick.velocity)} velocities and {len(tick.targets)} targets"
    for topic, field in _NUMBERS:
        values = record.column(topic, field)
        if not np.isfinite(values).all() or np.abs(values, out=values).max(initial=0.0) > _LARGEST:
            return f"{field} holds what no robot measures"
    if (np.linalg.norm(record.column("states", "quaternion"), axis=1) < 0.5).any():
        return "an orientation is no unit quaternion"
    return ""


def _read_into(path: Path, found: dict[str, list[tuple[float, Any]]]) -> tuple[dict[str, str], str]:
    """Sort every message of the file under its topic; returns facts and contract."""
    records = _modules()
    facts: dict[str, str] = {}
    contract, topics = "", {}
    decoder = msgspec.json.Decoder(TickRecord)
    for record in _records(path):
        if isinstance(record, records.Channel):
            topics[record.id] = record.topic
        elif isinstance(record, records.Metadata) and record.name in (FACTS_NAME, END_NAME):
            facts |= {name: printable(value) for name, value in record.metadata.items()}
        elif isinstance(record, records.Attachment) and record.name == CONTRACT_NAME:
            contract = record.data.decode()
        elif isinstance(record, records.Message) and (topic := topics.get(record.channel_id)) in found:
            message = (
                decoder.decode(record.data) if topic == TICK else decode(MESSAGE_TYPES[topic], record.data)
            )
            found[topic].append((1e-9 * record.log_time, message))
            if len(found[topic]) > MOST_MESSAGES:
                raise LogError(f"{printable(path)} holds more than {MOST_MESSAGES} messages of one kind")
    if "robot" not in facts:
        raise LogError(f"{printable(path)} is no log of sprintlab")
    return facts, contract


def _modules() -> Any:
    try:
        from mcap import records
    except ModuleNotFoundError as error:
        raise LogError("reading a log needs the package mcap: pip install 'sprintlab[log]'") from error
    return records


def _records(path: Path) -> Any:
    """Every record of the file in order, up to where it is cut off; chunks unpacked within bounds."""
    from mcap.exceptions import EndOfFile, RecordLengthLimitExceeded
    from mcap.records import Chunk
    from mcap.stream_reader import StreamReader, breakup_chunk

    content = read_bytes(path, LOG_LIMIT, what="log", error=LogError)
    reader = StreamReader(BytesIO(content), emit_chunks=True, record_size_limit=len(content))
    room, records = UNPACKED_LIMIT, 0
    try:
        for record in reader.records:
            if not isinstance(record, Chunk):
                yield record
                continue
            plain = _unpacked(record, min(room, _LARGEST_CHUNK))
            room -= len(plain.data)
            records += _counted(plain.data)
            if records > 4 * MOST_MESSAGES:
                raise LogError(f"{printable(path)} holds more than {4 * MOST_MESSAGES} records")
            yield from breakup_chunk(plain)
    except (EndOfFile, RecordLengthLimitExceeded, struct.error):  # a record that the file does not hold whole
        return
    except (SprintlabError, msgspec.DecodeError, UnicodeDecodeError):
        raise
    except Exception as error:  # of the library and of its decompressors
        raise LogError(f"{printable(path)} is no MCAP file, or damaged ({type(error).__name__})") from error


def _counted(data: bytes) -> int:
    """Number of records in a chunk; the first that is none of a chunk's ends the count with ``LogError``."""
    count, at = 0, 0
    while at + 9 <= len(data):
        kind, length = struct.unpack_from("<BQ", data, at)
        if kind not in _CHUNK_RECORDS:
            raise LogError("the log is damaged: a chunk holds a record of an unknown kind")
        count, at = count + 1, at + 9 + length
    return count


def _unpacked(chunk: Any, room: int) -> Any:
    """A chunk without compression; never unpacks more than ``room`` bytes. Raises ``LogError``."""
    from dataclasses import replace

    if chunk.compression == "":
        return chunk
    if chunk.compression != "zstd":
        raise LogError(f"a log of sprintlab is packed with zstd, not with {printable(chunk.compression, 20)}")
    import zstandard

    unpacker = zstandard.ZstdDecompressor(max_window_size=_LARGEST_WINDOW)
    with unpacker.stream_reader(chunk.data) as stream:
        data = stream.read(room + 1)
    if len(data) > room:
        raise LogError(
            f"the log, or a chunk of it, unpacks to more than {UNPACKED_LIMIT >> 20} or "
            f"{_LARGEST_CHUNK >> 20} MB, the most that is read"
        )
    return replace(chunk, compression="", data=data)


def _columns(messages: Sequence[tuple[float, Any]]) -> tuple[FloatArray, tuple[Any, ...]]:
    return np.array([time for time, _ in messages]), tuple(message for _, message in messages)
