"""Robot and controller on one machine: three rings in one memory-mapped file.

The file lies in ``/dev/shm`` where there is one. The robot holds a lock on it, which the system takes away
when the process ends, however it ends; a controller holds the lock on a second file: there is one at most.
"""

from __future__ import annotations

import fcntl
import mmap
import os
import sys
import tempfile
from pathlib import Path
from typing import IO

from sprintlab.deployment.bus.address import BusAddress, BusError
from sprintlab.deployment.bus.ends import COMMAND, FIX, STATE, BusEnd, ControllerEnd, RobotEnd
from sprintlab.deployment.bus.ring import RingReader, RingWriter, ring_size

_HEADER = 64  # bytes
_LAYOUT, _ROBOT_LEFT, _CONTROLLER_LEFT = range(3)
"""Words of the header: version of the layout, and whether an end has been closed."""
_VERSION = 5
_SLOTS = {STATE: 256, COMMAND: 256, FIX: 16}  # a quarter of a second at 1 kHz
_LONGEST = 1536  # bytes of a message
_SIZE = _HEADER + sum(ring_size(slots, _LONGEST) for slots in _SLOTS.values())


def memory_path(name: str) -> Path:
    """The file of a robot: in memory if the system has such a folder, else in the temporary folder."""
    memory = Path("/dev/shm")
    return (memory if memory.is_dir() else Path(tempfile.gettempdir())) / f"sprintlab-{name}"


class LockedFile:
    """A file that belongs to one process at a time; made if it does not exist, removed when released.

    Args:
        path: where.
        taken: what to say where another process has it.

    Raises:
        BusError: another process has it, or it cannot be made.
    """

    def __init__(self, path: Path, taken: str) -> None:
        self._path = path
        try:
            self.file = self._open()
            while not self._has_its_name():  # its last owner removed it meanwhile
                self.file.close()
                self.file = self._open()
        except BlockingIOError:
            raise BusError(taken) from None
        except OSError as error:
            raise BusError(f"cannot make {path}: {error.strerror or error}") from error

    def _open(self) -> IO[bytes]:
        file = os.fdopen(os.open(self._path, os.O_RDWR | os.O_CREAT, 0o600), "rb+")
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            file.close()
            raise
        return file

    def _has_its_name(self) -> bool:
        return self._path.exists() and os.path.samestat(self._path.stat(), os.fstat(self.file.fileno()))

    def release(self) -> None:
        """Let the next process have it; a second call does nothing."""
        if not self.file.closed:
            self._path.unlink(missing_ok=True)
            fcntl.flock(self.file, fcntl.LOCK_UN)  # whatever else is still open of it
            self.file.close()


class _Mapped(BusEnd):
    """One end: the file in memory, a ring for each channel."""

    _peer_word: int  # of the header: whether the other end has left

    def _map(self, file: IO[bytes], writes: tuple[str, ...]) -> None:
        memory = memoryview(mmap.mmap(file.fileno(), _SIZE))
        self._words, self._closed = memory[:_HEADER].cast("Q"), False
        self._writers: dict[str, RingWriter] = {}
        self._readers: dict[str, RingReader] = {}
        start = _HEADER
        for channel, slots in _SLOTS.items():
            part = memory[start : start + ring_size(slots, _LONGEST)]
            start += len(part)
            if channel in writes:
                self._writers[channel] = RingWriter(part, slots, _LONGEST)
            else:
                self._readers[channel] = RingReader(part, slots, _LONGEST)

    def _take(self, channel: str) -> bytes | None:
        return self._readers[channel].read()

    def _put(self, channel: str, content: bytes) -> None:
        self._writers[channel].write(content)

    @property
    def peer_left(self) -> bool:
        """Whether the other end has been closed in good order."""
        return self._closed or bool(self._words[self._peer_word])


class Interface(_Mapped, ControllerEnd):
    """The controller's end in shared memory.

    Raises:
        BusError: no robot of this name runs on this machine, or another controller drives it.
    """

    _peer_word = _ROBOT_LEFT

    def __init__(self, address: BusAddress, session: int) -> None:
        super().__init__(session)
        self._lock = controller_lock(_local_name(address), address.name)
        try:
            with _running(address.name) as file:
                self._map(file, writes=(COMMAND,))
        except BaseException:
            self._lock.release()
            raise
        self._words[_CONTROLLER_LEFT] = 0

    def close(self) -> None:
        """Let go of the bus; a second call does nothing."""
        if not self._closed:
            self._words[_CONTROLLER_LEFT], self._closed = 1, True
        self._lock.release()


class Endpoint(_Mapped, RobotEnd):
    """The robot's end in shared memory; it makes the file, and removes it when closed.

    Raises:
        BusError: a robot of this name runs already, or the memory cannot be had.
    """

    _peer_word = _CONTROLLER_LEFT

    def __init__(self, address: BusAddress) -> None:
        super().__init__()
        name = _local_name(address)
        self._owned = LockedFile(memory_path(name), f"a robot named {name!r} runs already on this machine")
        try:
            # All of the memory is taken now: without room, a write to a mapped file would end the process.
            self._owned.file.write(bytes(_SIZE))
            self._owned.file.flush()
        except OSError as error:
            self._owned.release()
            raise BusError(f"no memory for the robot {name!r}: {error.strerror or error}") from error
        self._map(self._owned.file, writes=(STATE, FIX))
        self._words[_LAYOUT] = _VERSION

    def close(self) -> None:
        """Let go of the bus and remove the file; a second call does nothing."""
        if not self._closed:
            self._words[_ROBOT_LEFT], self._closed = 1, True
        self._owned.release()


def controller_lock(place: str, robot: str) -> LockedFile:
    """Held by the one controller of a robot on this machine.

    Args:
        place: the robot's place, part of a file's name.
        robot: the robot's name, for the sentence.

    Raises:
        BusError: another controller holds it.
    """
    taken = f"another controller drives the robot {robot!r} on this machine"
    return LockedFile(memory_path(f"{place}.controller"), taken)


def _local_name(address: BusAddress) -> str:
    if address.place:
        raise BusError(f"shared memory is on this machine: leave @{address.place} out of the address")
    return address.name


def _running(name: str) -> IO[bytes]:
    """The file of a robot that runs.

    Raises:
        BusError: no robot of this name runs, or the robot behind the file has crashed.
    """
    try:
        file = memory_path(name).open("rb+")
    except OSError as error:
        raise BusError(f"no robot named {name!r} runs on this machine; start it first") from error
    problem = ""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        problem = f"the robot {name!r} has crashed and left its memory behind; start it again"
    except BlockingIOError:
        if int.from_bytes(file.read(8), sys.byteorder) != _VERSION:
            problem = f"the robot {name!r} speaks another version of sprintlab's messages"
    if problem:
        file.close()
        raise BusError(problem)
    return file
