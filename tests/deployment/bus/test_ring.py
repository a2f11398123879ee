"""The sequence-locked ring: order, overruns, torn copies."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sprintlab.deployment.bus.ring import RingReader, RingWriter, ring_size

SLOTS, SIZE = 8, 21  # a size that is no whole number of words


def ring():
    memory = memoryview(bytearray(ring_size(SLOTS, SIZE)))
    return RingWriter(memory, SLOTS, SIZE), RingReader(memory, SLOTS, SIZE), memory


def message(number):
    return number.to_bytes(SIZE, "little")


@given(st.lists(st.integers(0, 12), max_size=20))
def test_messages_come_in_order_and_the_newest_of_every_burst_arrive(bursts):
    writer, reader, _ = ring()
    written = 0
    for burst in bursts:
        for _ in range(burst):
            writer.write(message(written))
            written += 1
        got = [int.from_bytes(content, "little") for content in iter(reader.read, None)]
        assert got == list(range(written - min(burst, SLOTS - 1), written))


def test_a_message_longer_than_a_slot_is_refused():
    writer, reader, _ = ring()
    with pytest.raises(ValueError, match="22 bytes; a slot has 21"):
        writer.write(bytes(SIZE + 1))
    assert reader.read() is None


def test_a_message_that_changes_while_it_is_copied_is_dropped(monkeypatch):
    writer, reader, memory = ring()
    writer.write(message(7))
    writer.write(message(8))

    class Racing:
        """Memory in which the writer overtakes during the copy of the first message."""

        done = False

        def __getitem__(self, part):
            if not self.done:
                self.done = True
                for number in range(100, 100 + SLOTS):
                    writer.write(message(number))
            return memory[part]

    monkeypatch.setattr(reader, "_memory", Racing())
    assert reader.read() == message(101)  # 7 was torn, 8 and 100 were overwritten or about to be
