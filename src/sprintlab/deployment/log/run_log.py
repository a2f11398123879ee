"""The control thread's end of a log: it hands every tick to a process of its own and never waits.

The file is written elsewhere because compressing and writing in a thread would hold Python's global lock for
milliseconds, and because a log must survive the controller: when the controller dies, the pipe ends, and the
writer completes the file.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import select
import subprocess
from importlib.util import find_spec
from pathlib import Path
from typing import IO

import msgspec
import numpy as np

from sprintlab.core.files import check_writable
from sprintlab.core.interpreters import new_interpreter
from sprintlab.deployment.interface import ControlTick, encode
from sprintlab.deployment.log.topics import (
    COMMAND,
    END,
    FIX,
    START,
    STATE,
    TICK,
    TOPICS,
    Frame,
    LogError,
    TickRecord,
    pack,
)

_PIPE_SIZE = 1 << 20  # most of a second at 1 kHz
_PATIENCE = 10.0  # [s] with a writing process that takes nothing, or does not end
_MOST_FAULTS = 30  # of a step; with more a pipe might take a part of what is written of the step
_STATE, _COMMAND, _FIX, _TICK = (list(TOPICS).index(topic) for topic in (STATE, COMMAND, FIX, TICK))


class LogFacts(msgspec.Struct, frozen=True, kw_only=True):
    """What a log says of its run.

    Attributes:
        robot: name of the robot.
        contract: the policy's contract, JSON.
        facts: anything else worth keeping: command line, date, policy file, bus.
    """

    robot: str
    contract: str
    facts: dict[str, str] = {}


def check_new_log(path: Path) -> None:
    """Check that a log can be written to a file; leaves nothing behind but the file's folder.

    Raises:
        LogError: the file exists, its folder cannot be written, or the package ``mcap`` is missing.
    """
    if find_spec("mcap") is None:
        raise LogError("a log needs the package mcap: pip install 'sprintlab[log]'")
    if os.path.lexists(path):
        raise LogError(f"{path} exists already; choose another file for the log")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise LogError(f"cannot write {path}: {error.strerror or error}") from error
    check_writable(path)


class McapRunLog:
    """A ``RunLog`` that becomes an MCAP file.

    Args:
        path: where; must not exist yet.
        facts: the robot, the contract and notes about the run.
        wait: wait for the writing process rather than drop a tick, ten seconds at most: for runs that are not
            in real time.

    Attributes:
        dropped: ticks that the writing process was too slow to take.

    Raises:
        LogError: the file exists, its folder cannot be written, or the package ``mcap`` is missing.
    """

    def __init__(self, path: Path, facts: LogFacts, *, wait: bool = False) -> None:
        check_new_log(path)
        self.dropped = 0
        self._path, self._wait = path, wait
        self._last_state = 0
        self._encoder = msgspec.json.Encoder()
        self._writer = _start_writer(path)
        assert self._writer.stdin is not None and self._writer.stdout is not None
        self._pipe: IO[bytes] | None = self._writer.stdin
        if not self._writer.stdout.readline():
            raise LogError(self._complaint())
        self._writer.stdin.write(pack(Frame(START, 0, 0, msgspec.json.encode(facts))))
        self._writer.stdin.flush()
        os.set_blocking(self._writer.stdin.fileno(), False)

    def write(self, tick: ControlTick) -> None:
        """Keep one tick; what the writing process cannot take at once is dropped and counted."""
        time = round(1e9 * tick.time)
        state, command, fix = tick.state, tick.command, tick.fix
        content = pack(Frame(_COMMAND, time, command.sequence, encode(command)))
        content += pack(Frame(_TICK, time, command.sequence, self._encoder.encode(_record(tick))))
        if state is not None and state.sequence != self._last_state:
            self._last_state = state.sequence
            content += pack(Frame(_STATE, time, state.sequence, encode(state)))
        if fix is not None and np.isfinite((fix.position, fix.velocity)).all():
            content += pack(Frame(_FIX, time, fix.sequence, encode(fix)))
        self._put(content)

    def close(self) -> None:
        """Finish the file; a second call does nothing.

        Raises:
            LogError: the file could not be written to its end; the message says why.
        """
        if self._pipe is None:
            return
        self._has_room()
        with contextlib.suppress(OSError):
            os.write(self._pipe.fileno(), pack(Frame(END, 0, 0, str(self.dropped).encode())))
        with contextlib.suppress(OSError):
            self._pipe.close()
        self._pipe = self._writer.stdin = None
        complaint = self._complaint()
        if self._writer.returncode != 0:
            raise LogError(f"the log is not as it should be: {complaint}")

    def _complaint(self) -> str:
        """What the writing process says last, once it has ended."""
        try:
            said = self._writer.communicate(timeout=_PATIENCE)[1]
        except subprocess.TimeoutExpired:
            return f"its writer, process {self._writer.pid}, has not ended; if it goes on, so does the file"
        lines = said.decode(errors="replace").strip().splitlines()
        return (lines or ["its writer was killed"])[-1]

    def _has_room(self) -> bool:
        """Wait until the pipe takes a message, or its reader is gone; False when it takes none."""
        waiting = select.poll()
        waiting.register(self._pipe or 0, select.POLLOUT)
        return bool(waiting.poll(1e3 * _PATIENCE))

    def _put(self, content: bytes) -> None:
        """Give a tick to the pipe, which takes all of it or nothing."""
        if self._pipe is None:
            return
        self._wait = self._wait and self._has_room()
        try:
            os.write(self._pipe.fileno(), content)
        except OSError:  # full, or the writer is gone: the run matters more
            self.dropped += 1


def _record(tick: ControlTick) -> TickRecord:
    return TickRecord(
        time=tick.time,
        mode=tick.mode,
        velocity=tuple(tick.velocity.tolist()),
        targets=tuple(tick.targets.tolist()),
        policy_step=tick.policy_step,
        faults=tick.faults[:_MOST_FAULTS],
        compute_time=tick.compute_time,
    )


def _start_writer(path: Path) -> subprocess.Popen[bytes]:
    """The writing process; in a session of its own, so that Ctrl-C leaves it its work."""
    writer = subprocess.Popen(
        [*new_interpreter(), "-m", "sprintlab.deployment.log.writer", str(path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )
    if hasattr(fcntl, "F_SETPIPE_SZ") and writer.stdin is not None:
        with contextlib.suppress(OSError):
            fcntl.fcntl(writer.stdin.fileno(), fcntl.F_SETPIPE_SZ, _PIPE_SIZE)
    return writer
