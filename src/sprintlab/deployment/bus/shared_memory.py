"""Robot and controller on one machine: three rings in one memory-mapped file.

The file lies in ``/dev/shm`` where there is one. Its owner, the robot, holds a lock on it which the system
takes away when the process ends, however it ends: a file without a lock is left of a crash, and the next
robot of that name replaces it. A controller holds the lock on a second file, so that there is one at most.
"""

from __future__ import annotations

import contextlib
import fcntl
import mmap
import os
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import IO, NamedTuple

from sprintlab.deployment.bus.address import BusAddress, BusError
from sprintlab.deployment.bus.ends import COMMAND, FIX, STATE, BusEnd, ControllerEnd, RobotEnd
from sprintlab.deployment.bus.ring import RingReader, RingWriter, ring_size
from sprintlab.deployment.interface import JointCommand, PositionFix, RobotState, message_size

PREFIX = "sprintlab-"
"""How the names of the files begin."""

_MAGIC = 0x53505254_00000004  # "SPRT", version of this file's layout
_HEADER_WORDS = 8
_MAGIC_WORD, _ROBOT_LEFT, _CONTROLLER_LEFT = range(3)


class _Channel(NamedTuple):
    """One ring of the file."""

    kind: type[RobotState] | type[JointCommand] | type[PositionFix]
    slots: int

    @property
    def size(self) -> int:
        return ring_size(self.slots, message_size(self.kind))


# A quarter of a second at 1 kHz: more than any watchdog allows.
_CHANNELS = {
    STATE: _Channel(RobotState, 256),
    COMMAND: _Channel(JointCommand, 256),
    FIX: _Channel(PositionFix, 16),
}
_SIZE = 8 * _HEADER_WORDS + sum(channel.size for channel in _CHANNELS.values())


def shared_folder() -> Path:
    """Where the files are: memory if the system has such a folder, else the temporary folder."""
    memory = Path("/dev/shm")
    return memory if memory.is_dir() else Path(tempfile.gettempdir())


class ControllerLock:
    """Held by the one controller of a robot on this machine; it ends with the process that holds it.

    Args:
        place: the robot's place, part of a file's name.
        robot: the robot's name, for the sentence.

    Raises:
        BusError: another controller holds it, or its file cannot be made.
    """

    def __init__(self, place: str, robot: str) -> None:
        self._path = _path(f"{place}.controller")
        file = _open_locked(self._path)
        if file is None:
            raise BusError(f"another controller drives the robot {robot!r} on this machine")
        self._file = file

    def release(self) -> None:
        """Let the next controller in."""
        _remove(self._path, self._file)
        self._file.close()


class _Mapped(BusEnd):
    """One end: the file in memory, a ring for each kind of message."""

    _reads: str  # the ring of which ``lost`` tells
    _peer_word: int  # of the header: whether the other end has left

    def _map(self, file: IO[bytes]) -> None:
        self._file = file
        self._mapping = mmap.mmap(file.fileno(), _SIZE)
        self._memory = memoryview(self._mapping)
        self._words = self._memory[: 8 * _HEADER_WORDS].cast("Q")
        self._closed = False

    def _open_rings(self, *, writes: Sequence[str], reads: Sequence[str]) -> None:
        self._writers = {channel: RingWriter(*self._ring(channel)) for channel in writes}
        self._readers = {channel: RingReader(*self._ring(channel)) for channel in reads}

    def _ring(self, name: str) -> tuple[memoryview, int, int]:
        names = list(_CHANNELS)
        start = 8 * _HEADER_WORDS + sum(_CHANNELS[other].size for other in names[: names.index(name)])
        channel = _CHANNELS[name]
        return self._memory[start : start + channel.size], channel.slots, message_size(channel.kind)

    def _take(self, channel: str) -> bytes | None:
        return self._readers[channel].read()

    def _put(self, channel: str, content: bytes) -> None:
        self._writers[channel].write(content)

    @property
    def lost(self) -> int:
        """Messages that were overwritten before they were read: states, or commands."""
        return self._readers[self._reads].lost

    @property
    def peer_left(self) -> bool:
        """Whether the other end has been closed in good order."""
        return self._closed or bool(self._words[self._peer_word])

    def _release(self) -> None:
        self._closed = True
        for ring in (*self._writers.values(), *self._readers.values()):
            ring.release()
        self._words.release()
        self._memory.release()
        with contextlib.suppress(BufferError):
            self._mapping.close()
        self._file.close()


class SharedMemoryInterface(_Mapped, ControllerEnd):
    """The controller's end in shared memory.

    Raises:
        BusError: no robot of this name runs on this machine, or another controller drives it.
    """

    _reads, _peer_word = STATE, _ROBOT_LEFT

    def __init__(self, address: BusAddress, session: int) -> None:
        super().__init__(session)
        name = _local_name(address)
        self._lock = ControllerLock(name, name)
        try:
            self._map(_open_running(_path(name), name))
        except BaseException:
            self._lock.release()
            raise
        self._open_rings(writes=(COMMAND,), reads=(STATE, FIX))
        self._words[_CONTROLLER_LEFT] = 0

    def close(self) -> None:
        """Let go of the bus; a second call does nothing."""
        if not self._closed:
            self._words[_CONTROLLER_LEFT] = 1
            self._release()
            self._lock.release()


class SharedMemoryEndpoint(_Mapped, RobotEnd):
    """The robot's end in shared memory; it makes the file, and removes it when closed.

    Raises:
        BusError: a robot of this name runs already, or the memory cannot be had.
    """

    _reads, _peer_word = COMMAND, _CONTROLLER_LEFT

    def __init__(self, address: BusAddress) -> None:
        super().__init__()
        name = _local_name(address)
        self._path = _path(name)
        self._map(_create(self._path, name))
        self._open_rings(writes=(STATE, FIX), reads=(COMMAND,))
        self._words[_MAGIC_WORD] = _MAGIC

    def close(self) -> None:
        """Let go of the bus and remove the file; a second call does nothing."""
        if not self._closed:
            self._words[_ROBOT_LEFT] = 1
            _remove(self._path, self._file)
            self._release()


def _local_name(address: BusAddress) -> str:
    if address.place:
        raise BusError(f"shared memory is on this machine: leave @{address.place} out of the address")
    return address.name


def _path(name: str) -> Path:
    return shared_folder() / f"{PREFIX}{name}"


def _create(path: Path, name: str) -> IO[bytes]:
    """The robot's file under its lock, new and as large as it will be.

    All of the memory is taken now: without room, a write to a mapped file would end the process.
    """
    with contextlib.suppress(OSError), path.open("rb+") as left:
        if _lock(left):  # by a robot that crashed; whoever still has it mapped keeps it
            _remove(path, left)
    file = _open_locked(path)
    if file is None:
        raise BusError(f"a robot named {name!r} runs already on this machine")
    try:
        if hasattr(os, "posix_fallocate"):
            os.posix_fallocate(file.fileno(), 0, _SIZE)
        else:
            file.write(bytes(_SIZE))
            file.flush()
    except OSError as error:
        _remove(path, file)
        file.close()
        raise BusError(f"cannot make {path}: {error.strerror or error}") from error
    return file


def _open_running(path: Path, name: str) -> IO[bytes]:
    """The file of a robot that runs.

    Raises:
        BusError: no robot of this name runs, or the robot behind the file has crashed.
    """
    try:
        file = path.open("rb+")
    except OSError as error:
        raise BusError(f"no robot named {name!r} runs on this machine; start it first") from error
    problem = ""
    if _lock(file):
        problem = f"the robot {name!r} has crashed and left its memory behind; start it again"
    elif os.fstat(file.fileno()).st_size != _SIZE or file.read(8) != _MAGIC.to_bytes(8, sys.byteorder):
        problem = f"{path} was made by another version of sprintlab"
    if problem:
        file.close()
        raise BusError(problem)
    return file


def _open_locked(path: Path) -> IO[bytes] | None:
    """A file under an exclusive lock, made if it does not exist; None while another process has the lock.

    Raises:
        BusError: it cannot be made or opened.
    """
    while True:
        try:
            file = open(path, "rb+", opener=_private)  # noqa: SIM115
        except OSError as error:
            raise BusError(f"cannot open {path}: {error.strerror or error}") from error
        if not _lock(file):
            file.close()
            return None
        if _is_still(path, file):
            return file
        file.close()  # removed between opening and locking: try again


def _private(path: str, flags: int) -> int:
    """Open or make a file that other accounts can not open."""
    return os.open(path, flags | os.O_CREAT | os.O_NOFOLLOW, 0o600)


def _lock(file: IO[bytes]) -> bool:
    """Take the lock on an open file; False while another process has it."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _is_still(path: Path, file: IO[bytes]) -> bool:
    """Whether an open file still bears its name."""
    with contextlib.suppress(FileNotFoundError):
        return os.path.samestat(path.lstat(), os.fstat(file.fileno()))
    return False


def _remove(path: Path, file: IO[bytes]) -> None:
    """Take the name from an open file, unless another file has that name by now."""
    with contextlib.suppress(OSError):
        if _is_still(path, file):
            path.unlink()
