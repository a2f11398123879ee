"""What stands in a log file, and how it goes from the controller to the process that writes it."""

from __future__ import annotations

import struct
from typing import IO, Annotated, NamedTuple

import msgspec

from sprintlab.core.errors import SprintlabError
from sprintlab.deployment.interface import MOST_JOINTS

STATE, COMMAND, FIX, TICK = "/robot/state", "/robot/command", "/robot/fix", "/controller/tick"
TOPICS = (STATE, COMMAND, FIX, TICK)
"""Topics of a log; the first three hold the bus's own bytes, the last JSON."""

START, END = len(TOPICS), len(TOPICS) + 1
"""Frames that are no messages: facts of the run, JSON; number of ticks that were dropped, in words."""

MAGIC = b"\x89MCAP0\r\n"
"""How every MCAP file begins."""

CONTRACT_NAME = "contract.json"
FACTS_NAME = "sprintlab"
END_NAME = "sprintlab_end"

_HEAD = struct.Struct("<IBQQ")


class LogError(SprintlabError):
    """A log cannot be written or read."""


_Name = Annotated[str, msgspec.Meta(max_length=100)]


class TickRecord(msgspec.Struct, frozen=True, kw_only=True):
    """One line of ``/controller/tick``: what is not in the messages of the bus; see ``ControlTick``.

    The lengths bound what is read; a step of a controller stays far below them.
    """

    time: float
    mode: _Name
    velocity: Annotated[tuple[float, ...], msgspec.Meta(max_length=3)]
    targets: Annotated[tuple[float, ...], msgspec.Meta(max_length=MOST_JOINTS)]
    policy_step: bool
    faults: Annotated[tuple[_Name, ...], msgspec.Meta(max_length=1000)]
    compute_time: float


class Frame(NamedTuple):
    """One message on its way to the file.

    Attributes:
        topic: index into ``TOPICS``, or ``START`` or ``END``.
        time: controller's clock [ns].
        sequence: of the message.
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
