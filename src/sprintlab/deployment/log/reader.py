"""Reading a log file back as arrays."""

from __future__ import annotations

import os
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
from sprintlab.deployment.log.topics import CONTRACT_NAME, END_NAME, FACTS_NAME, TOPICS, LogError
from sprintlab.deployment.messages import FloatArray

LOG_LIMIT = 16 << 30
"""Largest log that is read [bytes]: more than an hour at 1 kHz."""
_MAGIC = b"\x89MCAP0\r\n"  # at both ends of a whole file


@dataclass(frozen=True, kw_only=True)
class Messages:
    """Messages of one topic."""

    time: FloatArray  # when each was noted, by the controller's clock [s] ``(n,)``
    columns: dict[str, NDArray[Any]]  # each field's values ``(n,)`` or ``(n, k)``; ``faults`` as tuples


@dataclass(frozen=True, kw_only=True)
class RunRecord:
    """A log in memory. Times are of the controller's clock [s]."""

    facts: dict[str, str]  # ``robot``, notes about the run, and ``ticks dropped`` if it came to its end
    contract: str  # the policy's contract, JSON
    states: Messages  # the accepted states; their time is when each was accepted
    commands: Messages  # the commands that were sent
    fixes: Messages  # the position fixes
    ticks: Messages  # mode, targets, faults and times of each control step, one per command

    def column(self, topic: str, field: str) -> NDArray[Any]:
        """One field ``(n,)`` or ``(n, k)`` of ``"states"``, ``"commands"``, ``"fixes"`` or ``"ticks"``."""
        return getattr(self, topic).columns[field]


def read_log(path: Path) -> RunRecord:
    """Read a log file; one that was cut off is read up to the cut."""
    require_package("mcap", extra="log", use="reading a log")
    try:
        with open_regular(path, LOG_LIMIT, what="log", error=LogError) as file:
            record = _record(file)
    except (ValueError, LookupError, RuntimeError, MemoryError) as error:
        raise LogError(f"{path} is damaged or no log of sprintlab: {printable(error)}") from error
    if not (len(record.states.time) and len(record.ticks.time)):
        raise LogError(f"{path} holds no run: no state or no control step was logged")
    return record


def _record(file: IO[bytes]) -> RunRecord:
    decoders = {
        topic: msgspec.json.Decoder(kind, dec_hook=lambda _, numbers: np.array(numbers, float)).decode
        for topic, kind in TOPICS.items()
    }
    found: dict[str, list[tuple[int, Any]]] = {topic: [] for topic in TOPICS}
    names: dict[int, str] = {}
    notes: dict[str, dict[str, str]] = {}
    contract = ""
    for item in _items(file):
        kind = type(item).__name__
        if kind == "Channel":
            names[item.id] = item.topic
        elif kind == "Message" and (topic := names[item.channel_id]) in decoders:
            found[topic].append((item.log_time, decoders[topic](item.data)))
        elif kind == "Metadata":
            notes[item.name] = item.metadata
        elif kind == "Attachment" and item.name == CONTRACT_NAME:
            contract = item.data.decode()
    if FACTS_NAME not in notes:
        raise ValueError("it says nothing of a robot")
    states, commands, fixes, ticks = (_arrays(TOPICS[topic], each) for topic, each in found.items())
    facts = {**notes[FACTS_NAME], **notes.get(END_NAME, {})}
    return RunRecord(
        facts=facts, contract=contract, states=states, commands=commands, fixes=fixes, ticks=ticks
    )


def _arrays(kind: Any, messages: list[tuple[int, Any]]) -> Messages:
    """One array per field; ``ValueError`` where times fall, or messages have not as many numbers in it."""
    time = 1e-9 * np.array([noted for noted, _ in messages], float)
    if (np.diff(time) < 0.0).any():
        raise ValueError(f"the times of its {kind.__name__}s do not rise")
    columns: dict[str, NDArray[Any]] = {}
    for name in kind.__struct_fields__:
        values = [getattr(message, name) for _, message in messages]
        columns[name] = np.fromiter(values, object) if name == "faults" else np.array(values)
    return Messages(time=time, columns=columns)


def _items(file: IO[bytes]) -> Iterator[Any]:
    """The records of an MCAP file, to where it was cut off; ``ValueError`` where a whole one is damaged."""
    from mcap.stream_reader import StreamReader

    file.seek(max(file.seek(0, os.SEEK_END) - len(_MAGIC), 0))
    whole = file.read() == _MAGIC
    file.seek(0)
    try:
        yield from StreamReader(file, validate_crcs=True).records
    except Exception as error:  # the library's, its compressor's and the struct module's own
        if whole:
            raise ValueError(str(error) or "a record is longer than the file") from error
