"""What a log file says of the form of its messages, so that other programs can read them."""

from __future__ import annotations

import inspect

import msgspec

from sprintlab.deployment.interface import FORMAT_VERSION, JointCommand, PositionFix, RobotState, message_size
from sprintlab.deployment.log.topics import COMMAND, FIX, STATE, TickRecord

MESSAGE_TYPES = {STATE: RobotState, COMMAND: JointCommand, FIX: PositionFix}


def tick_schema() -> bytes:
    """JSON schema of a tick, self-contained."""
    schema = msgspec.json.schema(TickRecord)
    return msgspec.json.encode(schema["$defs"]["TickRecord"])


def binary_schema(topic: str) -> tuple[str, bytes]:
    """Name and description of the binary messages of a topic."""
    kind = MESSAGE_TYPES[topic]
    description = {
        "format_version": FORMAT_VERSION,
        "bytes": message_size(kind, joints=0),
        "bytes_per_joint": message_size(kind, joints=1) - message_size(kind, joints=0),
        "byte_order": "little",
        "layout": "magic 'SPRT', u16 version, u16 kind, u64 sequence, u64 timestamp [ns], u64 whole numbers, "
        "f64 numbers in the order of the fields, u32 CRC-32 of all before",
        "fields": list(kind.__struct_fields__),
        "documentation": inspect.getdoc(kind),
    }
    return kind.__name__, msgspec.json.encode(description)
