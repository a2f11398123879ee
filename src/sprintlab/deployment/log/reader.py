"""Reading a log file back as arrays."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from sprintlab.deployment.interface import JointCommand, PositionFix, RobotState, decode
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
        LogError: there is no such file, it is no log of sprintlab, or the package ``mcap`` is missing.
    """
    found: dict[str, list[tuple[float, Any]]] = {STATE: [], COMMAND: [], FIX: [], TICK: []}
    facts, contract = _read_into(path, found)
    if not found[STATE] or not found[TICK]:
        raise LogError(f"{path} holds no run: no state or no control step was logged")
    state_time, states = _columns(found[STATE])
    command_time, commands = _columns(found[COMMAND])
    fix_time, fixes = _columns(found[FIX])
    return RunRecord(
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
            facts |= record.metadata
        elif isinstance(record, records.Attachment) and record.name == CONTRACT_NAME:
            contract = record.data.decode()
        elif isinstance(record, records.Message) and (topic := topics.get(record.channel_id)) in found:
            message = (
                decoder.decode(record.data) if topic == TICK else decode(MESSAGE_TYPES[topic], record.data)
            )
            found[topic].append((1e-9 * record.log_time, message))
    if "robot" not in facts:
        raise LogError(f"{path} is no log of sprintlab")
    return facts, contract


def _modules() -> Any:
    try:
        from mcap import records
    except ModuleNotFoundError as error:
        raise LogError("reading a log needs the package mcap: pip install 'sprintlab[log]'") from error
    return records


def _records(path: Path) -> Any:
    """Every record of the file in order, up to where it is cut off."""
    from mcap.exceptions import EndOfFile
    from mcap.stream_reader import StreamReader

    try:
        with path.open("rb") as file:
            try:
                yield from StreamReader(file).records
            except (EndOfFile, struct.error):
                return
            except Exception as error:  # of the library and of its decompressors
                raise LogError(f"{path} is no MCAP file, or damaged ({type(error).__name__})") from error
    except OSError as error:
        raise LogError(f"cannot read {path}: {error.strerror or error}") from error


def _columns(messages: Sequence[tuple[float, Any]]) -> tuple[FloatArray, tuple[Any, ...]]:
    return np.array([time for time, _ in messages]), tuple(message for _, message in messages)
