"""A ring of messages in memory that two processes share: one writes, one reads, neither waits.

Each slot has a stamp beside its bytes, which the writer makes odd before and even after it touches the
slot (a sequence lock); the reader copies the bytes and believes them only if the stamp was the expected one
before and after. A reader that is too slow loses the oldest messages. What a processor with weaker memory
ordering than x86 might still let through, the checksum inside each message catches.

Layout, in 8-byte words of the machine's own byte order: messages written so far, then for each slot its
stamp, the message's length in bytes, and room for the longest message.
"""

from __future__ import annotations

_WORD = 8


def ring_size(slots: int, message_size: int) -> int:
    """Bytes that a ring of ``slots`` messages of at most ``message_size`` bytes takes."""
    return _WORD * (1 + slots * (2 + -(-message_size // _WORD)))


class _Ring:
    """The layout, as reader and writer share it."""

    def __init__(self, memory: memoryview, slots: int, message_size: int) -> None:
        self._memory, self._words = memory, memory.cast("Q")
        self._slots, self._size = slots, message_size

    def _slot(self, index: int) -> int:
        """Word at which the slot of message ``index`` starts."""
        return 1 + (index % self._slots) * (2 + -(-self._size // _WORD))


class RingWriter(_Ring):
    """The end that writes; ``memory`` must hold zeros, or what an earlier writer left."""

    def write(self, message: bytes) -> None:
        """Put a message in the ring; the oldest one makes room.

        Raises:
            ValueError: it is longer than a slot.
        """
        if len(message) > self._size:
            raise ValueError(f"a message of {len(message)} bytes; a slot has {self._size}")
        index = self._words[0]
        word = self._slot(index)
        self._words[word] = 2 * index + 1
        self._words[word + 1] = len(message)
        start = _WORD * (word + 2)
        self._memory[start : start + len(message)] = message
        self._words[word] = 2 * index + 2
        self._words[0] = index + 1


class RingReader(_Ring):
    """The end that reads, from the oldest message that is still there when it comes."""

    _next = 0

    def read(self) -> bytes | None:
        """The next message, or None if all have been read."""
        while self._next < (written := self._words[0]):
            # The slot that the writer takes next is left alone.
            index = max(self._next, written - self._slots + 1)
            self._next = index + 1
            message = self._copy(index)
            if message is not None:
                return message
        return None

    def _copy(self, index: int) -> bytes | None:
        """A message; None if the writer has changed it meanwhile."""
        word, stamp = self._slot(index), 2 * index + 2
        if self._words[word] != stamp:
            return None
        start, length = _WORD * (word + 2), self._words[word + 1]
        message = bytes(self._memory[start : start + length])
        return message if self._words[word] == stamp else None
