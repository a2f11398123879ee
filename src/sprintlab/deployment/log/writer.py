"""``python -m sprintlab.deployment.log.writer FILE``: writes what comes down standard input as MCAP."""

from __future__ import annotations

import signal
import sys
from pathlib import Path
from typing import IO, Any

import msgspec
import numpy as np
from mcap.writer import CompressionType, Writer

from sprintlab.core.signals import terminations
from sprintlab.deployment.interface import ControlTick
from sprintlab.deployment.log.topics import (
    CONTRACT_NAME,
    END_NAME,
    FACTS_NAME,
    TOPICS,
    LogFacts,
    TickRecord,
    read_frame,
)

_CHUNK = 1 << 20  # bytes that are compressed together, a third of a second: so much a cut-off log may lose
_SEQUENCES = 1 << 32  # that MCAP tells apart; the message itself holds the whole number


def write_log(stream: IO[bytes], file: IO[bytes]) -> bool:
    """Write every frame of ``stream``: the facts, ticks, number of ticks dropped; whether any tick came.

    Raises:
        OSError: the disk is full; the file can be read up to there.
    """
    writer = Writer(file, _CHUNK, CompressionType.ZSTD, enable_data_crcs=True)
    writer.start(profile="", library="sprintlab")
    facts = msgspec.msgpack.decode(read_frame(stream) or b"", type=LogFacts)
    writer.add_metadata(FACTS_NAME, {"robot": facts.robot, **facts.facts})
    writer.add_attachment(0, 0, CONTRACT_NAME, "application/json", facts.contract.encode())
    channels = {topic: _channel(writer, topic, kind) for topic, kind in TOPICS.items()}
    decode = msgspec.msgpack.Decoder(ControlTick | int, dec_hook=lambda _, raw: np.frombuffer(raw)).decode
    encode = msgspec.json.Encoder(enc_hook=lambda array: array.tolist()).encode
    last: ControlTick | None = None
    while (frame := read_frame(stream)) is not None:
        tick = decode(frame)
        if isinstance(tick, int):
            writer.add_metadata(END_NAME, {"ticks dropped": str(tick)})
            break
        time = round(1e9 * tick.time)
        for topic, sequence, message in _messages(tick, last):
            writer.add_message(channels[topic], time, encode(message), time, sequence % _SEQUENCES)
        last = tick
    writer.finish()
    return last is not None


def _messages(tick: ControlTick, last: ControlTick | None) -> list[tuple[str, int, Any]]:
    """Topic, number and message of what is new in a tick; a fix only with finite numbers, as JSON has."""
    state, command, fix = tick.state, tick.command, tick.fix
    rest = TickRecord(**{name: getattr(tick, name) for name in TickRecord.__struct_fields__})
    found: list[tuple[str, int, Any]] = [
        ("/robot/command", command.sequence, command),
        ("/controller/tick", command.sequence, rest),
    ]
    before = last.state.sequence if last is not None and last.state is not None else None
    if state is not None and state.sequence != before:
        found.append(("/robot/state", state.sequence, state))
    if fix is not None and np.isfinite((fix.position, fix.velocity)).all():
        found.append(("/robot/fix", fix.sequence, fix))
    return found


def _channel(writer: Writer, topic: str, kind: Any) -> int:
    """Register a topic with the JSON schema of its messages: every property an array, or a plain type."""
    _, parts = msgspec.json.schema_components(
        [kind], schema_hook=lambda _: {"type": "array", "items": {"type": "number"}}
    )
    properties = parts[kind.__name__]["properties"]
    for name, value in properties.items():
        if "$ref" in value:
            properties[name] = {"type": "integer", **parts[value["$ref"].rpartition("/")[2]]}
    schema = msgspec.json.encode(parts[kind.__name__])
    return writer.register_channel(topic, "json", writer.register_schema(kind.__name__, "jsonschema", schema))


def main(path: Path) -> None:
    """Write a new file; a run that ended before its first step leaves none."""
    # A session's end asks the run to end, too, which takes seconds to come down: they belong into the log.
    for kind in (signal.SIGINT, *terminations()):
        signal.signal(kind, signal.SIG_IGN)
    try:
        with path.open("xb") as file:
            print("ready", flush=True)
            begun = write_log(sys.stdin.buffer, file)
        if not begun:
            path.unlink()
    except FileExistsError:
        sys.exit(f"{path} exists already; choose another file for the log")
    except OSError as error:
        sys.exit(f"{path} ends before the run does: {error.strerror or error}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
