"""The control thread hands every tick to a process of its own, which writes the file as MCAP.

Compressing and writing in a thread would hold Python's global lock for milliseconds. And the log survives its
controller: when that dies, the pipe between the two ends, and the writer completes the file.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import select
import signal
import struct
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import IO, Any

import msgspec
import numpy as np

from sprintlab.core.files import check_writable
from sprintlab.core.interpreters import new_interpreter
from sprintlab.core.signals import terminations
from sprintlab.deployment.log.topics import (
    CONTRACT_NAME,
    END_NAME,
    FACTS_NAME,
    TOPICS,
    LogError,
    LogFacts,
    TickRecord,
)
from sprintlab.deployment.messages import ControlTick

_PIPE_SIZE = 1 << 20  # bytes: most of a second at 1 kHz
_WHOLE = 4096  # bytes: a pipe takes no more in one piece, or nothing
_PATIENCE = 10.0  # [s] with a writing process that takes nothing, or does not end
_CHUNK = 1 << 20  # bytes that are compressed together, a third of a second: so much a cut-off log may lose
_SEQUENCES = 1 << 32  # that MCAP tells apart; the message itself holds the whole number
_LENGTH = struct.Struct("<I")  # stands before each message to the writing process


def check_new_log(path: Path) -> None:
    """Check that a log can be written to a file; leaves nothing behind."""
    if find_spec("mcap") is None:
        raise LogError("a log needs the package mcap: pip install 'sprintlab[log]'")
    if os.path.lexists(path):
        raise LogError(f"{path} exists already; choose another file for the log")
    check_writable(path)


class McapRunLog:
    """Becomes an MCAP file; ``dropped`` counts ticks that the writing process was too slow to take.

    With ``wait`` it waits for that process, ten seconds at most: for runs that are not in real time.
    """

    def __init__(self, path: Path, facts: LogFacts, *, wait: bool = False) -> None:
        check_new_log(path)
        self.dropped, self._wait = 0, wait
        self._encode = msgspec.msgpack.Encoder(enc_hook=lambda array: array.tobytes()).encode
        self._writer = subprocess.Popen(
            [*new_interpreter(), "-c", f"from {__name__} import main; main()", str(path)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            start_new_session=True,  # so that Ctrl-C leaves it its work
        )
        assert self._writer.stdin is not None and self._writer.stdout is not None
        if not self._writer.stdout.readline():
            raise LogError(self._complaint())
        self._pipe = self._writer.stdin.fileno()
        if hasattr(fcntl, "F_SETPIPE_SZ"):
            with contextlib.suppress(OSError):
                fcntl.fcntl(self._pipe, fcntl.F_SETPIPE_SZ, _PIPE_SIZE)
        self._writer.stdin.write(self._frame(facts))
        self._writer.stdin.flush()
        os.set_blocking(self._pipe, False)

    def write(self, tick: ControlTick) -> None:
        """Keep one tick; what the writing process cannot take at once is dropped and counted."""
        self._wait = self._wait and self._has_room()
        content = self._frame(tick)
        try:
            whole = len(content) <= _WHOLE and os.write(self._pipe, content) == len(content)
        except OSError:  # full, or the writer is gone: the run matters more
            whole = False
        self.dropped += not whole

    def close(self) -> None:
        """Finish the file, once; raises ``LogError`` where it could not be written to its end."""
        stdin, self._writer.stdin = self._writer.stdin, None
        if stdin is None:
            return
        self._has_room()
        with contextlib.suppress(OSError):
            os.write(self._pipe, self._frame(self.dropped))
        with contextlib.suppress(OSError):
            stdin.close()
        complaint = self._complaint()
        if self._writer.returncode != 0:
            raise LogError(f"the log is not as it should be: {complaint}")

    def _frame(self, content: Any) -> bytes:
        body = self._encode(content)
        return _LENGTH.pack(len(body)) + body

    def _complaint(self) -> str:
        """What the writing process says last, once it has ended."""
        try:
            said = self._writer.communicate(timeout=_PATIENCE)[1]
        except subprocess.TimeoutExpired:
            return f"its writer, process {self._writer.pid}, has not ended; if it goes on, so does the file"
        return (said.decode(errors="replace").strip().splitlines() or ["its writer was killed"])[-1]

    def _has_room(self) -> bool:
        """Wait until the pipe takes a message, or its reader is gone; False when it takes none."""
        waiting = select.poll()
        waiting.register(self._pipe, select.POLLOUT)
        return bool(waiting.poll(1e3 * _PATIENCE))


def _next_frame(stream: IO[bytes]) -> bytes | None:
    """Content of the next frame; None at the end, or where the sender was cut off."""
    head = stream.read(_LENGTH.size)
    length = _LENGTH.unpack(head)[0] if len(head) == _LENGTH.size else 0
    content = stream.read(length)
    return content if length and len(content) == length else None


def write_log(stream: IO[bytes], file: IO[bytes]) -> bool:
    """Write every frame of ``stream``: the facts, ticks, number of ticks dropped; whether any tick came."""
    from mcap.writer import CompressionType, Writer

    writer = Writer(file, _CHUNK, CompressionType.ZSTD, enable_data_crcs=True)
    writer.start(profile="", library="sprintlab")
    facts = msgspec.msgpack.decode(_next_frame(stream) or b"", type=LogFacts)
    writer.add_metadata(FACTS_NAME, {"robot": facts.robot, **facts.facts})
    writer.add_attachment(0, 0, CONTRACT_NAME, "application/json", facts.contract.encode())
    channels = {topic: _channel(writer, topic, kind) for topic, kind in TOPICS.items()}
    decode = msgspec.msgpack.Decoder(ControlTick | int, dec_hook=lambda _, raw: np.frombuffer(raw)).decode
    encode = msgspec.json.Encoder(enc_hook=lambda array: array.tolist()).encode
    last: ControlTick | None = None
    while (frame := _next_frame(stream)) is not None:
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


def _channel(writer: Any, topic: str, kind: Any) -> int:
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


def main() -> None:
    """Write the file that the first argument names; a run that ended before its first step leaves none."""
    path = Path(sys.argv[1])
    for kind in (signal.SIGINT, *terminations()):  # the seconds of coming down belong into the log
        signal.signal(kind, signal.SIG_IGN)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("xb") as file:
            print("ready", flush=True)
            begun = write_log(sys.stdin.buffer, file)
        if not begun:
            path.unlink()
    except OSError as error:
        sys.exit(f"{path} ends before the run does: {error.strerror or error}")
