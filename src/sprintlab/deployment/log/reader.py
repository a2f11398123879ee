"""Reading a log file back as arrays."""

from __future__ import annotations

import os
import struct
from array import array
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from sprintlab.core.errors import printable
from sprintlab.core.extras import require_package
from sprintlab.core.reading import open_regular
from sprintlab.deployment.log.topics import (
    COMMAND,
    CONTRACT_NAME,
    END_NAME,
    FACTS_NAME,
    FIX,
    STATE,
    TICK,
    TOPICS,
    LogError,
)

FloatArray = NDArray[np.float64]

LOG_LIMIT = 16 << 30
"""Largest log that is read [bytes]: more than an hour at 1 kHz."""
_LARGEST_RECORD = 64 << 20  # bytes
_MAGIC = b"\x89MCAP0\r\n"  # at both ends of a whole file
_PLAIN = (bool, int, float, str)


class Messages:
    """Messages of one topic, as columns.

    Args:
        kind: type of the messages.
    """

    def __init__(self, kind: Any) -> None:
        fields = [(f.name, _read_type(f.name, f.type)) for f in msgspec.structs.fields(kind)]
        self._decoder = msgspec.json.Decoder(msgspec.defstruct(kind.__name__, fields))
        self._times = array("Q")
        self._vectors = {name: array("d") for name, type_ in fields if type_ == list[float]}
        self._scalars: dict[str, list[Any]] = {n: [] for n, _ in fields if n not in self._vectors}

    def add(self, time: int, content: bytes) -> None:
        """Keep one message; raises ``msgspec.DecodeError`` where it has other fields."""
        message = self._decoder.decode(content)
        self._times.append(time)
        for name, values in self._vectors.items():
            values.extend(getattr(message, name))
        for name, values in self._scalars.items():
            values.append(getattr(message, name))

    @property
    def time(self) -> FloatArray:
        """When each message was noted [s] ``(n,)``."""
        return np.frombuffer(self._times, dtype=np.uint64).astype(np.float64) * 1e-9

    def column(self, field: str) -> NDArray[Any]:
        """One field of all messages ``(n,)`` or ``(n, k)``; ``faults`` as tuples of names."""
        if field == "faults":
            return np.fromiter(map(tuple, self._scalars[field]), dtype=object, count=len(self))
        if field in self._scalars:
            return np.array(self._scalars[field])
        return np.array(self._vectors[field]).reshape(len(self), -1) if len(self) else np.empty((0, 0))

    def __len__(self) -> int:
        return len(self._times)


def _read_type(name: str, type_: Any) -> Any:
    """The type in which a field is read: arrays of numbers as lists."""
    if name == "faults":
        return list[str]
    if isinstance(type_, type) and issubclass(type_, _PLAIN):
        return type_
    return list[float]


@dataclass(frozen=True, kw_only=True)
class RunRecord:
    """A log in memory. Times are of the controller's clock [s].

    Attributes:
        facts: notes about the run; ``robot`` is always there, ``ticks dropped`` unless the
            controller did not come to its end.
        contract: the policy's contract, JSON.
        states: the accepted states; their time is when each was accepted.
        commands: the commands that were sent.
        fixes: the position fixes.
        ticks: mode, targets, faults and times of each control step, one per command.
    """

    facts: dict[str, str]
    contract: str
    states: Messages
    commands: Messages
    fixes: Messages
    ticks: Messages

    @property
    def state_time(self) -> FloatArray:
        """When each state was accepted ``(S,)``."""
        return self.states.time

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
        LogError: there is no such file, it is no log of sprintlab, it is damaged or too large, or the package
            ``mcap`` is missing.
    """
    require_package("mcap", extra="log", use="reading a log")
    try:
        with open_regular(path, LOG_LIMIT, what="log", error=LogError) as file:
            record = _record(file)
    except LogError:
        raise
    except (ValueError, LookupError, struct.error, RuntimeError, MemoryError) as error:
        raise LogError(f"{printable(path)} is damaged or no log of sprintlab: {printable(error)}") from error
    if not (len(record.states) and len(record.ticks)):
        raise LogError(f"{printable(path)} holds no run: no state or no control step was logged")
    return record


def _record(file: IO[bytes]) -> RunRecord:
    topics = {topic: Messages(kind) for topic, kind in TOPICS.items()}
    channels: dict[int, Messages] = {}
    notes: dict[str, dict[str, str]] = {}
    contract = ""
    for item in _records(file):
        name = type(item).__name__
        if name == "Message" and item.channel_id in channels:
            channels[item.channel_id].add(item.log_time, item.data)
        elif name == "Channel" and item.topic in topics:
            channels[item.id] = topics[item.topic]
        elif name == "Metadata":
            notes[item.name] = item.metadata
        elif name == "Attachment" and item.name == CONTRACT_NAME:
            contract = item.data.decode()
    if FACTS_NAME not in notes:
        raise ValueError("it says nothing of a robot")
    facts = {**notes[FACTS_NAME], **notes.get(END_NAME, {})}
    record = RunRecord(
        facts={printable(key, 100): printable(value) for key, value in facts.items()},
        contract=contract,
        states=topics[STATE],
        commands=topics[COMMAND],
        fixes=topics[FIX],
        ticks=topics[TICK],
    )
    _check(record)
    return record


def _records(file: IO[bytes]) -> Iterator[Any]:
    """The records of an MCAP file, to where it was cut off; ``ValueError`` where a whole one is damaged."""
    from mcap.exceptions import McapError
    from mcap.stream_reader import StreamReader
    from zstandard import ZstdError

    file.seek(max(file.seek(0, os.SEEK_END) - len(_MAGIC), 0))
    whole = file.read() == _MAGIC
    file.seek(0)
    try:
        yield from StreamReader(file, validate_crcs=True, record_size_limit=_LARGEST_RECORD).records
    except (McapError, ZstdError, ValueError, struct.error) as error:
        if whole:
            raise ValueError(str(error) or "a record is longer than the file") from error


def _check(record: RunRecord) -> None:
    """Refuse what no run can have logged."""
    per_joint = (
        *(("states", f"joint_{name}") for name in ("position", "velocity", "torque")),
        ("ticks", "targets"),
    )
    if len({record.column(*place).shape[1] for place in per_joint if len(getattr(record, place[0]))}) > 1:
        raise ValueError("its messages do not all have the same number of joints")
    for name in ("states", "fixes", "ticks"):
        if (np.diff(getattr(record, name).time) < 0.0).any():
            raise ValueError(f"the times of its {name} do not rise")
