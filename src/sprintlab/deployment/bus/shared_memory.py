"""Robot and controller on one machine: three rings in one memory-mapped file.

The file lives in ``/dev/shm`` where there is one. Its owner, the robot, holds a lock on it which the system
takes away when the process ends, however it ends: a file without a lock is the rest of a crash, and the next
robot removes it. A controller holds a lock of its own on a second file, so that there is one at most.
"""

from __future__ import annotations

import contextlib
import fcntl
import mmap
import os
import stat
import struct
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import IO, NamedTuple

from sprintlab.deployment.bus.address import BusAddress, BusError
from sprintlab.deployment.bus.ends import COMMAND, FIX, STATE, BusEnd, ControllerEnd, RobotEnd
from sprintlab.deployment.bus.ring import RingReader, RingWriter, ring_size
from sprintlab.deployment.interface import JointCommand, PositionFix, RobotState, message_size

PREFIX = "sprintlab-"
"""How the names of the files begin."""

_MAGIC = 0x53505254_00000003  # "SPRT", version of this file's layout
_LOCK_CONTENT = b"SPRTLOCK"
_HEADER_WORDS = 8
_MAGIC_WORD, _ROBOT_LEFT, _CONTROLLER_LEFT, _SESSION = range(4)


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


def shared_folder() -> Path:
    """Where the files are: memory if the system has such a folder, else the temporary folder."""
    memory = Path("/dev/shm")
    return memory if memory.is_dir() else Path(tempfile.gettempdir())


def remove_orphans(folder: Path | None = None) -> list[str]:
    """Delete files of robots and controllers that are gone; a foreign file of a similar name is left alone.

    Returns:
        The names of the robots whose files were deleted.
    """
    removed = []
    for path in (folder or shared_folder()).glob(f"{PREFIX}*"):
        with contextlib.suppress(OSError), _open_own(path) as file:
            if file is not None and _lock(file) and _remove(path, file):
                removed.append(path.name.removeprefix(PREFIX))
    return sorted(removed)


@contextlib.contextmanager
def _open_own(path: Path) -> Iterator[IO[bytes] | None]:
    """A file that this module made, open; None for any other: links, folders, pipes, foreign content."""
    handle = os.open(path, os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK)
    with os.fdopen(handle, "rb+") as file:
        status = os.fstat(handle)
        first = os.pread(handle, 8, 0) if stat.S_ISREG(status.st_mode) else b""
        robot = first == struct.pack("=Q", _MAGIC) and status.st_size == _size()
        yield file if robot or (first == _LOCK_CONTENT and status.st_size == 8) else None


def open_interface(address: BusAddress, session: int, config: Path | None) -> SharedMemoryInterface:
    """The controller's end.

    Raises:
        BusError: no robot of this name runs on this machine, or another controller drives it.
    """
    _refuse_place(address, config)
    return SharedMemoryInterface(address.name, session)


def open_endpoint(address: BusAddress, config: Path | None) -> SharedMemoryEndpoint:
    """The robot's end.

    Raises:
        BusError: a robot of this name runs already, or the memory cannot be had.
    """
    _refuse_place(address, config)
    return SharedMemoryEndpoint(address.name)


class ControllerLock:
    """Held by the one controller of a robot on this machine; it ends with the process that holds it.

    Args:
        place: of the robot; part of a file's name.
        robot: its name, for the sentence.

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

    def __init__(self, file: IO[bytes], path: Path) -> None:
        self._file, self._path = file, path
        self._map = mmap.mmap(file.fileno(), 0)
        self._memory = memoryview(self._map)
        self._words = self._memory[: 8 * _HEADER_WORDS].cast("Q")
        self._writers: dict[str, RingWriter] = {}
        self._readers: dict[str, RingReader] = {}
        self._closed = False

    def _open_rings(self, *, writes: Sequence[str], reads: Sequence[str]) -> None:
        self._writers = {channel: RingWriter(*self._ring(channel)) for channel in writes}
        self._readers = {channel: RingReader(*self._ring(channel)) for channel in reads}

    def _ring(self, name: str) -> tuple[memoryview, int, int]:
        channel = _CHANNELS[name]
        return self._part(name), channel.slots, message_size(channel.kind)

    def _part(self, name: str) -> memoryview:
        start = 8 * _HEADER_WORDS
        for other, channel in _CHANNELS.items():
            if other == name:
                break
            start += channel.size
        return self._memory[start : start + _CHANNELS[name].size]

    def _take(self, channel: str) -> bytes | None:
        return self._readers[channel].read()

    def _put(self, channel: str, content: bytes) -> None:
        self._writers[channel].write(content)

    def _release(self) -> None:
        self._closed = True
        for ring in (*self._writers.values(), *self._readers.values()):
            ring.release()
        self._words.release()
        self._memory.release()
        with contextlib.suppress(BufferError):
            self._map.close()
        self._file.close()


class SharedMemoryInterface(_Mapped, ControllerEnd):
    """The controller's end in shared memory."""

    def __init__(self, name: str, session: int) -> None:
        self.session = session
        path, self._lock = _path(name), ControllerLock(name, name)
        try:
            super().__init__(_open_running(path, name), path)
            if len(self._map) != _size() or self._words[_MAGIC_WORD] != _MAGIC:
                raise BusError(f"{path} was made by another version of sprintlab")
        except BaseException:
            self._lock.release()
            raise
        self._open_rings(writes=(COMMAND,), reads=(STATE, FIX))
        self._words[_SESSION] = session
        self._words[_CONTROLLER_LEFT] = 0

    @property
    def lost(self) -> int:
        """States that were overwritten before they were read."""
        return self._readers[STATE].lost

    @property
    def peer_left(self) -> bool:
        """Whether the robot has closed its end in good order."""
        return self._closed or bool(self._words[_ROBOT_LEFT])

    def close(self) -> None:
        """Let go of the bus; a second call does nothing."""
        if self._closed:
            return
        if self._words[_SESSION] == self.session:  # else another one has come in: its lock was taken away
            self._words[_CONTROLLER_LEFT] = 1
        self._release()
        self._lock.release()


class SharedMemoryEndpoint(_Mapped, RobotEnd):
    """The robot's end in shared memory; it makes the file, and removes it when closed."""

    def __init__(self, name: str) -> None:
        path = _path(name)
        remove_orphans()
        file = _create(path, struct.pack("=Q", _MAGIC), _size())
        if file is None:
            raise BusError(f"a robot named {name!r} runs already on this machine")
        super().__init__(file, path)
        self._open_rings(writes=(STATE, FIX), reads=(COMMAND,))

    @property
    def lost(self) -> int:
        """Commands that were overwritten before they were read."""
        return self._readers[COMMAND].lost

    @property
    def peer_left(self) -> bool:
        """Whether the last controller has closed its end in good order."""
        return self._closed or bool(self._words[_CONTROLLER_LEFT])

    def _admitted(self, session: int) -> bool:
        return session == self._words[_SESSION] != 0

    def close(self) -> None:
        """Let go of the bus and remove the file; a second call does nothing."""
        if self._closed:
            return
        self._words[_ROBOT_LEFT] = 1
        _remove(self._path, self._file)
        self._release()


def _refuse_place(address: BusAddress, config: Path | None) -> None:
    if address.place:
        raise BusError(f"shared memory is on this machine: leave @{address.place} out of the address")
    if config is not None:
        raise BusError("shared memory is on this machine and needs no --bus-config")


def _size() -> int:
    return 8 * _HEADER_WORDS + sum(channel.size for channel in _CHANNELS.values())


def _path(name: str) -> Path:
    return shared_folder() / f"{PREFIX}{name}"


def _lock(file: IO[bytes]) -> bool:
    """Take the lock on an open file if nobody has it."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _create(path: Path, first: bytes, size: int) -> IO[bytes] | None:
    """A new file of zeros under its lock, ``first`` at its beginning; None if there is one already.

    It gets its name only when it is locked and complete: nobody can take it for an orphan, or see half of it,
    and a process that is killed before leaves nothing.
    """
    name, file = "", None
    try:
        handle, name = _open_nameless(path)
        file = os.fdopen(handle, "rb+")
        _lock(file)
        _take_room(file, size)
        file.write(first)
        file.flush()
        os.link(name, path, src_dir_fd=handle)  # with a folder, it follows a link such as that of /proc
    except OSError as error:
        if file is not None:
            file.close()
        if isinstance(error, FileExistsError):
            return None
        raise BusError(f"cannot make {path}: {error.strerror or error}") from error
    finally:
        with contextlib.suppress(OSError):
            os.unlink(name)
    return file


def _open_nameless(path: Path) -> tuple[int, str]:
    """A file in the folder of ``path``, and by what it can be linked: hidden where none can be nameless."""
    try:
        handle = os.open(path.parent, os.O_TMPFILE | os.O_RDWR, 0o600)
    except (AttributeError, OSError):
        return tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    return handle, f"/proc/self/fd/{handle}"


def _take_room(file: IO[bytes], size: int) -> None:
    """All of the memory now: without room, a write to a mapped file would end the process without a word."""
    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(file.fileno(), 0, size)
    else:
        file.write(bytes(size))
        file.seek(0)


def _open_running(path: Path, name: str) -> IO[bytes]:
    """The file of a robot that runs.

    Raises:
        BusError: no robot of this name runs, it is another account's, or the robot behind it has crashed.
    """
    try:
        file = open(path, "rb+", opener=_private)  # noqa: SIM115
    except OSError as error:
        raise BusError(f"no robot named {name!r} runs on this machine; start it first") from error
    if os.fstat(file.fileno()).st_uid != os.geteuid():
        file.close()
        raise BusError(f"{path} is another account's: who made it may pose as the robot {name!r}")
    if _lock(file):
        file.close()
        raise BusError(f"the robot {name!r} has crashed and left its memory behind; start it again")
    if os.fstat(file.fileno()).st_size != _size():
        file.close()
        raise BusError(f"{path} is no memory of a robot of this version of sprintlab")
    return file


def _open_locked(path: Path) -> IO[bytes] | None:
    """A lock file of one's own; None while another process has it.

    Raises:
        BusError: it cannot be made, or another account's or a foreign file has its name, which is left alone.
    """
    while True:
        file = _create(path, _LOCK_CONTENT, len(_LOCK_CONTENT))
        if file is not None:
            return file
        try:
            file = open(path, "rb+", opener=_private)  # noqa: SIM115
        except FileNotFoundError:
            continue  # another controller has just left
        except OSError as error:
            raise BusError(f"cannot open {path}: {error.strerror or error}") from error
        if not _lock(file):
            file.close()
            return None
        if _is_still(path, file):
            if os.fstat(file.fileno()).st_uid != os.geteuid():
                file.close()
                raise BusError(f"{path} is another account's, which can take it away: remove it first")
            if os.pread(file.fileno(), 9, 0) != _LOCK_CONTENT:
                file.close()
                raise BusError(f"{path} is no file of sprintlab, and its name is needed: move it away")
            return file
        file.close()


def _private(path: str, flags: int) -> int:
    """Open a file that other accounts can neither open nor put a link in place of."""
    return os.open(path, flags | os.O_NOFOLLOW, 0o600)


def _is_still(path: Path, file: IO[bytes]) -> bool:
    """Whether an open file still bears its name: somebody may have tidied up between opening and locking."""
    with contextlib.suppress(FileNotFoundError):
        return os.path.samestat(path.lstat(), os.fstat(file.fileno()))
    return False


def _remove(path: Path, file: IO[bytes]) -> bool:
    """Take the name from an open file; what somebody has put in its place meanwhile stays."""
    with contextlib.suppress(OSError):
        if _is_still(path, file):
            path.unlink()
            return True
    return False
