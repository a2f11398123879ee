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
import time
from importlib.util import find_spec
from pathlib import Path
from typing import IO

import msgspec

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
_PATIENCE = 10.0  # s with a writing process that takes nothing, or does not end: it may have been stopped
_START_TIME = 20.0  # s that a writing process may take to be up: half a second of a core, which may be busy
_MOST_FAULTS = 30  # of a step; with more a pipe might take a part of what is written of the step
_STATE, _COMMAND, _FIX, _TICK = (TOPICS.index(topic) for topic in (STATE, COMMAND, FIX, TICK))


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
    """That a log can be written to a file; leaves nothing behind but the file's folder.

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
        facts: what to say of the run.
        wait: wait for the writing process rather than drop a tick, ten seconds at most: for runs that are not
            in real time.

    Attributes:
        dropped: ticks that the writing process was too slow to take.

    Raises:
        LogError: the file exists or is being written, its folder cannot be written, or the package ``mcap``
            is missing.
    """

    def __init__(self, path: Path, facts: LogFacts, *, wait: bool = False) -> None:
        check_new_log(path)
        self.dropped = 0
        self._path, self._wait = path, wait
        self._last_state = 0
        self._writer = _start_writer(path)
        self._pipe: IO[bytes] | None = self._writer.stdin
        self._send_facts(facts)
        self._encoder = msgspec.json.Encoder()

    def write(self, tick: ControlTick) -> None:
        """Keep one tick; what the writing process cannot take at once is dropped and counted."""
        time = round(1e9 * tick.time)
        state, command = tick.state, tick.command
        content = pack(Frame(_COMMAND, time, command.sequence, encode(command)))
        content += pack(Frame(_TICK, time, command.sequence, self._encoder.encode(_record(tick))))
        if state is not None and state.sequence != self._last_state:
            self._last_state = state.sequence
            content += pack(Frame(_STATE, time, state.sequence, encode(state)))
        if tick.fix is not None:
            content += pack(Frame(_FIX, time, tick.fix.sequence, encode(tick.fix)))
        self._put(content)

    def close(self) -> None:
        """Finish the file; a second call does nothing.

        Raises:
            LogError: the file could not be written to its end, or has another name; the message says why.
        """
        if self._pipe is None:
            return
        room = self._wait_for_room()
        with contextlib.suppress(OSError):
            os.write(self._pipe.fileno(), pack(Frame(END, 0, 0, str(self.dropped).encode())))
        self._pipe.close()
        self._pipe = self._writer.stdin = None
        complaint = self._complaint(_PATIENCE if room else 0.0)
        if self._writer.returncode != 0:
            raise LogError(f"the log {self._path} is not as it should be: {complaint}")

    def _complaint(self, patience: float = _PATIENCE) -> str:
        """What the writing process says last; waits for its end [s], which a stopped one does not come to."""
        try:
            said = self._writer.communicate(timeout=patience)[1]
        except subprocess.TimeoutExpired:
            return f"its writer, process {self._writer.pid}, has not ended; if it goes on, so does the file"
        lines = said.decode(errors="replace").strip().splitlines()
        return (lines or ["its writer was killed"])[-1]

    def _wait_for_room(self) -> bool:
        """Wait until the pipe takes a message, or nobody reads it any more; False when it takes none."""
        assert self._pipe is not None
        return _comes(self._pipe, select.POLLOUT, time.monotonic() + _PATIENCE)

    def _send_facts(self, facts: LogFacts) -> None:
        """The first thing down the pipe; then wait until the writer is up, if it comes up at all."""
        assert self._pipe is not None and self._writer.stdout is not None
        os.set_blocking(self._pipe.fileno(), False)
        deadline = time.monotonic() + _START_TIME
        taken = self._give(pack(Frame(START, 0, 0, msgspec.json.encode(facts))), deadline)
        if not (taken and _comes(self._writer.stdout, select.POLLIN, deadline)):
            self._writer.kill()
            self._complaint()
            raise LogError(
                f"the log {self._path} cannot be begun: its writer did not start in {_START_TIME:g} s"
            )
        if not self._writer.stdout.readline():
            with contextlib.suppress(BrokenPipeError):
                self._pipe.close()
            self._writer.stdin = None
            raise LogError(self._complaint())

    def _give(self, content: bytes, deadline: float) -> bool:
        """Give all of it to the pipe; False where that is not done at the deadline [s]."""
        assert self._pipe is not None
        left = memoryview(content)
        with contextlib.suppress(BrokenPipeError):  # what a writer that is gone has to say comes later
            while left and _comes(self._pipe, select.POLLOUT, deadline):
                left = left[os.write(self._pipe.fileno(), left) :]
            return not left
        return True

    def _put(self, content: bytes) -> None:
        """Give a tick to the pipe, which takes all of it or nothing."""
        if self._pipe is None:
            return
        self._wait = self._wait and self._wait_for_room()
        try:
            os.write(self._pipe.fileno(), content)
        except OSError:  # full, or the writer is gone: the run matters more
            self.dropped += 1


def _comes(stream: IO[bytes], event: int, deadline: float) -> bool:
    """Wait for an event of a stream, or for the end of who is behind it; False at the deadline [s]."""
    waiting = select.poll()
    waiting.register(stream, event)
    return bool(waiting.poll(max(1e3 * (deadline - time.monotonic()), 0.0)))


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
    assert writer.stdin is not None
    if hasattr(fcntl, "F_SETPIPE_SZ"):
        with contextlib.suppress(OSError):
            fcntl.fcntl(writer.stdin.fileno(), fcntl.F_SETPIPE_SZ, _PIPE_SIZE)
    return writer
