"""What stands in a log file, and how it goes from the controller to the process that writes it."""

from __future__ import annotations

import struct
from typing import IO, Any, NamedTuple

import msgspec

from sprintlab.core.errors import SprintlabError
from sprintlab.deployment.interface import JointCommand, PositionFix, RobotState

CONTRACT_NAME = "contract.json"
FACTS_NAME, END_NAME = "sprintlab", "sprintlab_end"
"""Metadata: the facts of the run, and the number of ticks that were dropped."""

_HEAD = struct.Struct("<IBQQ")


class LogError(SprintlabError):
    """A log cannot be written or read."""


class TickRecord(msgspec.Struct, frozen=True, kw_only=True):
    """The rest of a ``ControlTick``, beside the messages of the bus."""

    time: float
    mode: str
    velocity: tuple[float, ...]
    targets: tuple[float, ...]
    policy_step: bool
    faults: tuple[str, ...]
    compute_time: float


STATE, COMMAND, FIX, TICK = "/robot/state", "/robot/command", "/robot/fix", "/controller/tick"
TOPICS: dict[str, Any] = {STATE: RobotState, COMMAND: JointCommand, FIX: PositionFix, TICK: TickRecord}
"""Topics of a log and the types of their messages, which the file holds as JSON."""
START, END = len(TOPICS), len(TOPICS) + 1
"""Frames that are no messages: facts of the run, JSON; number of ticks that were dropped, in words."""


def schema(topic: str) -> bytes:
    """JSON schema of a topic's messages: every property an array, or a plain type."""
    kind = TOPICS[topic]
    _, parts = msgspec.json.schema_components(
        [kind], schema_hook=lambda _: {"type": "array", "items": {"type": "number"}}
    )
    properties = parts[kind.__name__]["properties"]
    for name, value in properties.items():
        if "$ref" in value:
            properties[name] = {"type": "integer", **parts[value["$ref"].rpartition("/")[2]]}
    return msgspec.json.encode(parts[kind.__name__])


class Frame(NamedTuple):
    """One message on its way to the file.

    Attributes:
        topic: index into ``TOPICS``, or ``START`` or ``END``.
        time: controller's clock [ns].
        sequence: the message's number.
        content: its bytes.
    """

    topic: int
    time: int
    sequence: int
    content: bytes


def pack(frame: Frame) -> bytes:
    """The frame's bytes. A pipe takes fewer than 4096 bytes that are written at once whole, or not at all."""
    return _HEAD.pack(len(frame.content), frame.topic, frame.time, frame.sequence) + frame.content


def read_frame(stream: IO[bytes]) -> Frame | None:
    """The next frame; None at the end, or where the sender was cut off."""
    head = stream.read(_HEAD.size)
    if len(head) < _HEAD.size:
        return None
    length, topic, time, sequence = _HEAD.unpack(head)
    content = stream.read(length)
    return Frame(topic, time, sequence, content) if len(content) == length else None
