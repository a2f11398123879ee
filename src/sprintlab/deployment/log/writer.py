"""``python -m sprintlab.deployment.log.writer FILE``: writes what comes down standard input as MCAP."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import IO, Any

import msgspec
from mcap.writer import CompressionType, Writer

from sprintlab.deployment.log.run_log import LogFacts
from sprintlab.deployment.log.schemas import binary_schema, tick_schema
from sprintlab.deployment.log.topics import CONTRACT_NAME, END, END_NAME, FACTS_NAME, TICK, TOPICS, read_frame


def write_log(stream: IO[bytes], path: Path) -> None:
    """Write every frame of ``stream``; the file gets its name when it is complete."""
    temporary = path.with_name(f".{path.name}.partial")
    with temporary.open("wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD)
        writer.start(profile="", library="sprintlab")
        _write_facts(writer, stream)
        channels = _register(writer)
        print("ready", flush=True)
        while (frame := read_frame(stream)) is not None:
            if frame.topic == END:
                writer.add_metadata(END_NAME, {"ticks dropped": frame.content.decode()})
                continue
            writer.add_message(channels[frame.topic], frame.time, frame.content, frame.time, frame.sequence)
        writer.finish()
    os.replace(temporary, path)


def _write_facts(writer: Any, stream: IO[bytes]) -> None:
    frame = read_frame(stream)
    if frame is None:
        return
    facts = msgspec.json.decode(frame.content, type=LogFacts)
    writer.add_metadata(FACTS_NAME, {"robot": facts.robot, **facts.facts})
    writer.add_attachment(0, 0, CONTRACT_NAME, "application/json", facts.contract.encode())


def _register(writer: Any) -> list[int]:
    channels = []
    for topic in TOPICS:
        if topic == TICK:
            schema = writer.register_schema("ControlTick", "jsonschema", tick_schema())
            channels.append(writer.register_channel(topic, "json", schema))
        else:
            name, text = binary_schema(topic)
            schema = writer.register_schema(name, "sprintlab", text)
            channels.append(writer.register_channel(topic, "sprintlab", schema))
    return channels


if __name__ == "__main__":
    write_log(sys.stdin.buffer, Path(sys.argv[1]))
