"""``python -m sprintlab.deployment.log.writer FILE``: writes what comes down standard input as MCAP."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import signal
import stat
import sys
from io import RawIOBase
from pathlib import Path
from typing import IO, Any

import msgspec
from mcap.writer import CompressionType, Writer

from sprintlab.core.files import numbered
from sprintlab.core.signals import terminations
from sprintlab.deployment.log.run_log import LogFacts
from sprintlab.deployment.log.schemas import binary_schema, tick_schema
from sprintlab.deployment.log.topics import (
    CONTRACT_NAME,
    END,
    END_NAME,
    FACTS_NAME,
    MAGIC,
    TICK,
    TOPICS,
    LogError,
    read_frame,
)

_CHUNK = 1 << 18  # bytes that are compressed together, a quarter of a second: so much a cut-off log may lose
_SEQUENCES = 1 << 32  # that MCAP tells apart; the message itself holds the whole number


class _Whole:
    """A file that takes all of what is written, or says at once that it cannot; nothing waits in memory."""

    def __init__(self, file: RawIOBase) -> None:
        self._file = file

    def write(self, content: bytes) -> int:
        """Write all of it; an ``OSError`` where the disk ends."""
        left = memoryview(content)
        while left:
            left = left[self._file.write(left) or 0 :]
        return len(content)

    def tell(self) -> int:
        """Bytes so far."""
        return self._file.tell()

    def flush(self) -> None:
        """Nothing waits."""


def write_log(stream: IO[bytes], path: Path) -> OSError | None:
    """Write every frame of ``stream``; the file gets its name when it is complete, or when the disk is full.

    Of a run that was ended while it began, before its first step, there is no file.

    Returns:
        What went wrong: the log ends before the stream does, and holds what fitted; or something else took
        its name meanwhile, and it has another one.

    Raises:
        LogError: another process writes this log, or has written it.
        OSError: no file can be made in its folder.
    """
    temporary = path.with_name(f".{path.name}.partial")
    failure, begun = None, True
    with _claimed(temporary, path) as file:
        with contextlib.suppress(BrokenPipeError):  # the run has ended as it began: the stream says so, too
            print("ready", flush=True)
        try:
            writer = Writer(_as_stream(file), _CHUNK, CompressionType.ZSTD, enable_data_crcs=True)
            begun = _write_frames(stream, writer)
        except OSError as error:
            failure = OSError(error.errno, f"it ends before the run does: {error.strerror or error}")
        if not _is_still(temporary, file.fileno()):
            return OSError(errno.ENOENT, f"{temporary} was taken away while it was written: there is no log")
        if not begun:
            temporary.unlink()
            return None
        placed = _named(temporary, path)
    if placed != path:
        failure = OSError(errno.EEXIST, f"it is {placed.name}, since another file took its name meanwhile")
    return failure


def _stay_to_the_end() -> None:
    """Who ends a session or asks all of sprintlab to end asks the run, too, which takes seconds to come down.

    Those are the seconds that one wants to see. The writer ends with its stream, however the run does.
    """
    for kind in (signal.SIGINT, *terminations()):
        signal.signal(kind, signal.SIG_IGN)


def _named(temporary: Path, path: Path) -> Path:
    """Give a log its name, or one beside it: what somebody has put there meanwhile stays."""
    for name in numbered(path, path.suffix):
        with contextlib.suppress(FileExistsError):
            _move(temporary, name)
            return name
    return temporary


def _move(temporary: Path, path: Path) -> None:
    """Give a file a name that nothing has; raises ``FileExistsError``."""
    try:
        os.link(temporary, path)
    except FileExistsError:
        raise
    except OSError:  # a disk without links
        if os.path.lexists(path):
            raise FileExistsError(path) from None
        os.replace(temporary, path)
    else:
        temporary.unlink()


def _claimed(temporary: Path, path: Path) -> RawIOBase:
    """A new file that this process holds as long as it is open: of several writers of one log one gets it."""
    while True:
        _remove_left(temporary, path)
        with contextlib.suppress(FileExistsError):
            file = temporary.open("xb", buffering=0)
            if _held(file.fileno()) and _is_still(temporary, file.fileno()):
                break
            file.close()  # another writer took it for one left behind
    if os.path.lexists(path):
        temporary.unlink()
        file.close()
        raise LogError(f"{path} exists already; choose another file for the log")
    return file


def _remove_left(temporary: Path, path: Path) -> None:
    """Remove the file of a writer that was killed; refuse what else has its name."""
    foreign = LogError(f"{temporary} is no log, and has the name of the unfinished one: move it away")
    with contextlib.suppress(FileNotFoundError):
        if not stat.S_ISREG(temporary.lstat().st_mode):
            raise foreign
        handle = os.open(temporary, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
        try:
            if not _held(handle):
                raise LogError(f"{path} is being written by another run; choose another file for the log")
            if not MAGIC.startswith(os.read(handle, len(MAGIC))):
                raise foreign
            if _is_still(temporary, handle):
                temporary.unlink()
        finally:
            os.close(handle)


def _held(handle: int) -> bool:
    """Whether no other process holds an open file; this one does now, where the disk knows locks."""
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        return not isinstance(error, BlockingIOError)
    return True


def _is_still(path: Path, handle: int) -> bool:
    """Whether an open file still bears its name."""
    with contextlib.suppress(FileNotFoundError):
        return os.path.samestat(path.lstat(), os.fstat(handle))
    return False


def _as_stream(file: RawIOBase) -> Any:
    return _Whole(file)


def _write_frames(stream: IO[bytes], writer: Any) -> bool:
    """Whether there was a step, or an end in order, in the stream."""
    writer.start(profile="", library="sprintlab")
    _write_facts(writer, stream)
    channels, begun = _register(writer), False
    while (frame := read_frame(stream)) is not None:
        begun = True
        if frame.topic == END:
            writer.add_metadata(END_NAME, {"ticks dropped": frame.content.decode()})
            continue
        short = frame.sequence % _SEQUENCES
        writer.add_message(channels[frame.topic], frame.time, frame.content, frame.time, short)
    writer.finish()
    return begun


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
    _stay_to_the_end()
    try:
        problem = write_log(sys.stdin.buffer, Path(sys.argv[1]))
    except LogError as error:
        sys.exit(str(error))
    except OSError as error:
        sys.exit(f"cannot write {sys.argv[1]}: {error.strerror or error}")
    if problem is not None:
        sys.exit(problem.strerror or str(problem))
