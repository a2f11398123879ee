"""Robot and controller on one machine: three rings of messages in one memory-mapped file.

The file lies in ``/dev/shm`` where there is one. The robot holds a lock on it, which the system takes away
when the process ends, however it ends; a controller holds the lock on a second file: there is one at most.
"""

from __future__ import annotations

import fcntl
import mmap
import os
import tempfile
from pathlib import Path
from typing import IO

from sprintlab.core.errors import SprintlabError
from sprintlab.deployment.transports.address import BusAddress
from sprintlab.deployment.transports.ends import COMMAND, FIX, STATE, Carrier, ControllerEnd, RobotEnd

_VERSION = 6  # layout of the memory; part of the file's name
_WORD = 8  # bytes
_ROBOT_LEFT, _CONTROLLER_LEFT = range(2)  # words at the begin: whether an end has been closed
_SLOTS = {STATE: 256, COMMAND: 256, FIX: 16}  # a quarter of a second at 1 kHz
_LONGEST = 1536  # bytes of a message
_SLOT = 2 + _LONGEST // _WORD  # words


class Ring:
    """A ring of messages in memory that two processes share: one writes, one reads, neither waits.

    Each slot has a stamp beside its bytes, which the writer makes odd before and even after it touches the
    slot (a sequence lock); the reader copies the bytes and believes them only if the stamp was the expected
    one before and after. A reader that is too slow loses the oldest messages. What a processor with weaker
    memory ordering than x86 might still let through, the checksum inside each message catches.

    Layout, in words of 8 bytes: messages written so far, then for each slot its stamp, the message's length
    in bytes, and room for the longest message.
    """

    def __init__(self, memory: memoryview, slots: int) -> None:
        self._memory, self._words, self._slots = memory, memory.cast("Q"), slots
        self._next = 0

    @staticmethod
    def size(slots: int) -> int:
        """Bytes that a ring takes."""
        return _WORD * (1 + slots * _SLOT)

    def write(self, message: bytes) -> None:
        """Put a message in the ring, in place of the oldest; raises ``ValueError`` where it is too long."""
        if len(message) > _LONGEST:
            raise ValueError(f"a message of {len(message)} bytes; a slot has {_LONGEST}")
        index = self._words[0]
        word = 1 + index % self._slots * _SLOT
        self._words[word] = 2 * index + 1
        self._words[word + 1] = len(message)
        start = _WORD * (word + 2)
        self._memory[start : start + len(message)] = message
        self._words[word] = 2 * index + 2
        self._words[0] = index + 1

    def read(self) -> bytes | None:
        """The next message, or None if all have been read."""
        while self._next < (written := self._words[0]):
            index = max(self._next, written - self._slots + 1)  # the writer takes the slot before it next
            self._next = index + 1
            word, stamp = 1 + index % self._slots * _SLOT, 2 * index + 2
            if self._words[word] == stamp:
                start, length = _WORD * (word + 2), self._words[word + 1]
                message = bytes(self._memory[start : start + length])
                if self._words[word] == stamp:
                    return message
        return None


_SIZE = 2 * _WORD + sum(map(Ring.size, _SLOTS.values()))


class _SharedMemory(Carrier):
    """One end's view of the memory."""

    def __init__(self, file: IO[bytes], lock: FileLock, own_word: int) -> None:
        memory = memoryview(mmap.mmap(file.fileno(), _SIZE))
        self._words, self._own_word, self._lock = memory[: 2 * _WORD].cast("Q"), own_word, lock
        self._words[own_word] = 0
        self._rings: dict[str, Ring] = {}
        start = 2 * _WORD
        for channel, slots in _SLOTS.items():
            self._rings[channel] = Ring(memory[start : start + Ring.size(slots)], slots)
            start += Ring.size(slots)

    def take(self, channel: str) -> bytes | None:
        return self._rings[channel].read()

    def put(self, channel: str, content: bytes) -> None:
        self._rings[channel].write(content)

    @property
    def peer_left(self) -> bool:
        """Whether the other end, or this one, has been closed in good order."""
        return any(self._words)

    def close(self) -> None:
        if not self._lock.released:
            self._words[self._own_word] = 1
            self._lock.release()


class FileLock:
    """A file that one process at a time holds, removed when it is released; the system ends a crashed hold.

    ``taken`` is said where another process holds it.
    """

    def __init__(self, path: Path, taken: str) -> None:
        self._path = path
        try:
            self.file = os.fdopen(os.open(path, os.O_RDWR | os.O_CREAT, 0o600), "rb+")
            fcntl.flock(self.file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self.file.close()
            raise SprintlabError(taken) from None
        except OSError as error:
            raise SprintlabError(f"cannot make {path}: {error.strerror or error}") from error

    @property
    def released(self) -> bool:
        """Whether the next process may have it."""
        return self.file.closed

    def release(self) -> None:
        """Let the next process have it; a second call does nothing."""
        if not self.released:
            self._path.unlink(missing_ok=True)
            fcntl.flock(self.file, fcntl.LOCK_UN)  # the mapped memory still keeps it open
            self.file.close()


def memory_path(name: str) -> Path:
    """The file of a robot: in memory if the system has such a folder, else in the temporary folder."""
    memory = Path("/dev/shm")
    return (memory if memory.is_dir() else Path(tempfile.gettempdir())) / f"sprintlab{_VERSION}-{name}"


def controller_lock(place: str, robot: str) -> FileLock:
    """Held by the one controller of the robot at a place; raises where another one holds it."""
    taken = f"another controller drives the robot {robot!r} on this machine"
    return FileLock(memory_path(f"{place}.controller"), taken)


def controller_end(address: BusAddress, session: int) -> ControllerEnd:
    """The controller's end; raises ``SprintlabError`` without a robot, or with another controller."""
    name = _local_name(address)
    lock = controller_lock(name, name)
    try:
        with _running(name) as file:
            return ControllerEnd(_SharedMemory(file, lock, _CONTROLLER_LEFT), session)
    except BaseException:
        lock.release()
        raise


def robot_end(address: BusAddress) -> RobotEnd:
    """The robot's end, which makes the file; raises where a robot of this name runs already."""
    name = _local_name(address)
    lock = FileLock(memory_path(name), f"a robot named {name!r} runs already on this machine")
    try:
        lock.file.write(bytes(_SIZE))  # all is taken now: without room, a later write would end the process
        lock.file.flush()
    except OSError as error:
        lock.release()
        raise SprintlabError(f"no memory for the robot {name!r}: {error.strerror or error}") from error
    return RobotEnd(_SharedMemory(lock.file, lock, _ROBOT_LEFT))


def _local_name(address: BusAddress) -> str:
    if address.place:
        raise SprintlabError(f"shared memory is on this machine: leave @{address.place} out of the address")
    return address.name


def _running(name: str) -> IO[bytes]:
    """The file of a robot that runs, which a crashed one no longer holds."""
    try:
        file = memory_path(name).open("rb+")
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        file.close()
    except BlockingIOError:
        return file  # pyright: ignore[reportPossiblyUnboundVariable]
    except OSError:
        pass
    raise SprintlabError(f"no robot named {name!r} runs on this machine; start it first")
