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

import msgspec

from sprintlab.core.files import check_writable
from sprintlab.core.interpreters import new_interpreter
from sprintlab.deployment.interface import ControlTick
from sprintlab.deployment.log.topics import LogError, LogFacts, pack

_PIPE_SIZE = 1 << 20  # bytes: most of a second at 1 kHz
_WHOLE = 4096  # bytes: a pipe takes no more in one piece, or nothing
_PATIENCE = 10.0  # [s] with a writing process that takes nothing, or does not end


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
        self.dropped, self._wait = 0, wait
        self._encode = msgspec.msgpack.Encoder(enc_hook=lambda array: array.tobytes()).encode
        self._writer = subprocess.Popen(
            [*new_interpreter(), "-m", "sprintlab.deployment.log.writer", str(path)],
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
        self._writer.stdin.write(pack(self._encode(facts)))
        self._writer.stdin.flush()
        os.set_blocking(self._pipe, False)

    def write(self, tick: ControlTick) -> None:
        """Keep one tick; what the writing process cannot take at once is dropped and counted."""
        self._wait = self._wait and self._has_room()
        content = pack(self._encode(tick))
        try:
            whole = len(content) <= _WHOLE and os.write(self._pipe, content) == len(content)
        except OSError:  # full, or the writer is gone: the run matters more
            whole = False
        self.dropped += not whole

    def close(self) -> None:
        """Finish the file; a second call does nothing.

        Raises:
            LogError: the file could not be written to its end; the message says why.
        """
        stdin = self._writer.stdin
        if stdin is None:
            return
        self._has_room()
        with contextlib.suppress(OSError):
            os.write(self._pipe, pack(self._encode(self.dropped)))
        with contextlib.suppress(OSError):
            stdin.close()
        self._writer.stdin = None
        complaint = self._complaint()
        if self._writer.returncode != 0:
            raise LogError(f"the log is not as it should be: {complaint}")

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
