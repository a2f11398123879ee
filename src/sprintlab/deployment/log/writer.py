"""``python -m sprintlab.deployment.log.writer FILE``: writes what comes down standard input as MCAP."""

from __future__ import annotations

import signal
import sys
from pathlib import Path
from typing import IO, Any

import msgspec
from mcap.writer import CompressionType, Writer

from sprintlab.core.signals import terminations
from sprintlab.deployment.interface import decode
from sprintlab.deployment.log.run_log import LogFacts
from sprintlab.deployment.log.topics import (
    CONTRACT_NAME,
    END,
    END_NAME,
    FACTS_NAME,
    TICK,
    TOPICS,
    read_frame,
    schema,
)

_CHUNK = 1 << 20  # bytes that are compressed together, a third of a second: so much a cut-off log may lose
_SEQUENCES = 1 << 32  # that MCAP tells apart; the message itself holds the whole number


def write_log(stream: IO[bytes], file: IO[bytes]) -> bool:
    """Write every frame of ``stream``; whether any came.

    Raises:
        OSError: the disk is full; the file can be read up to there.
    """
    writer = Writer(file, _CHUNK, CompressionType.ZSTD, enable_data_crcs=True)
    writer.start(profile="", library="sprintlab")
    _write_facts(writer, stream)
    channels = [
        writer.register_channel(
            topic, "json", writer.register_schema(kind.__name__, "jsonschema", schema(topic))
        )
        for topic, kind in TOPICS.items()
    ]
    topics, kinds = list(TOPICS), list(TOPICS.values())
    encoder = msgspec.json.Encoder(enc_hook=lambda array: array.tolist())
    begun = False
    while (frame := read_frame(stream)) is not None:
        begun = True
        if frame.topic == END:
            writer.add_metadata(END_NAME, {"ticks dropped": frame.content.decode()})
            continue
        content = frame.content
        if topics[frame.topic] != TICK:
            content = encoder.encode(decode(kinds[frame.topic], content))
        short = frame.sequence % _SEQUENCES
        writer.add_message(channels[frame.topic], frame.time, content, frame.time, short)
    writer.finish()
    return begun


def _write_facts(writer: Any, stream: IO[bytes]) -> None:
    frame = read_frame(stream)
    if frame is None:
        return
    facts = msgspec.json.decode(frame.content, type=LogFacts)
    writer.add_metadata(FACTS_NAME, {"robot": facts.robot, **facts.facts})
    writer.add_attachment(0, 0, CONTRACT_NAME, "application/json", facts.contract.encode())


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
