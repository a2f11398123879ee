"""Shared memory that is not ours, or was written over: one sentence, and commands that still go out."""

import struct
import subprocess
import sys
import uuid

import numpy as np
import pytest

from sprintlab.deployment.bus.address import BusError, open_bus, open_endpoint
from sprintlab.deployment.bus.ends import COMMAND
from sprintlab.deployment.bus.ring import RingReader, RingWriter, ring_size
from sprintlab.deployment.bus.shared_memory import PREFIX, _size, shared_folder
from sprintlab.deployment.interface import JointCommand, JointMode, encode

SLOTS, SIZE = 8, 20


@pytest.mark.parametrize(
    ("size", "match"),
    [*((size, "no memory of a robot") for size in (0, 10, 64, 4096)), (_size(), "another version")],
)
def test_a_file_that_no_robot_of_this_version_made_is_refused(size, match):
    name = f"t{uuid.uuid4().hex[:12]}"
    path = shared_folder() / f"{PREFIX}{name}"
    try:
        with path.open("wb") as file:
            file.write(bytes(size))
            file.flush()
            # The lock of a robot that runs: held by another process, as a robot's would be.
            holder = subprocess.Popen(
                [
                    sys.executable,
                    "-c",
                    "import fcntl, sys; f = open(sys.argv[1], 'rb+'); fcntl.flock(f, fcntl.LOCK_EX); "
                    "print('held', flush=True); sys.stdin.read()",
                    str(path),
                ],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
            )
            try:
                assert holder.stdout.readline() == b"held\n"
                with pytest.raises(BusError, match=match):
                    open_bus(f"shm://{name}")
                assert not (shared_folder() / f"{PREFIX}{name}.controller").exists()
            finally:
                holder.stdin.close()
                holder.stdout.close()
                holder.wait()
    finally:
        path.unlink(missing_ok=True)


def rings(fill=b"\0"):
    memory = memoryview(bytearray(fill * ring_size(SLOTS, SIZE)))
    return memory, RingWriter(memory, SLOTS, SIZE), RingReader(memory, SLOTS, SIZE)


def message(number):
    return struct.pack("<Q12x", number)


@pytest.mark.parametrize("head", [2**64 - 1, 2**63, 2**62, 10**6])
def test_writer_goes_on_when_its_head_is_written_over(head):
    memory, writer, reader = rings()
    for number in range(5):
        writer.write(message(number))
    memory.cast("Q")[0] = head
    assert [reader.read() for _ in range(SLOTS + 2)].count(None) >= 2  # nothing hangs, nothing is believed
    assert reader.lost <= SLOTS or head <= 2**62  # nor are messages counted as lost that nobody sent
    for number in range(100, 100 + SLOTS):
        writer.write(message(number))
    seen = []
    while (content := reader.read()) is not None:
        seen.append(struct.unpack_from("<Q", content)[0])
    assert seen and seen[-1] == 99 + SLOTS


@pytest.mark.parametrize("fill", [b"\xff", b"\x7f", b"\x01"])
def test_ring_of_rubbish(fill):
    _, writer, reader = rings(fill)
    assert reader.read() is None
    writer.write(message(7))
    assert reader.read() in (None, message(7))
    writer.write(message(8))
    assert reader.read() in (message(7), message(8))


def test_ring_written_over_at_random_never_raises():
    rng = np.random.default_rng(0)
    memory, writer, reader = rings()
    words = memory.cast("Q")
    for step in range(3000):
        words[int(rng.integers(len(words)))] = [0, 1, 2**62, 2**63, 2**64 - 1, step][rng.integers(6)]
        writer.write(message(step))
        reader.read()
    fresh = RingReader(memory, SLOTS, SIZE)
    for number in range(SLOTS):
        writer.write(message(number))
    assert message(SLOTS - 1) in [fresh.read() for _ in range(SLOTS)]


def test_last_damping_command_arrives_over_a_head_that_was_written_over():
    name = f"t{uuid.uuid4().hex[:12]}"
    endpoint = open_endpoint(f"shm://{name}")
    try:
        interface = open_bus(f"shm://{name}")
        try:
            start = interface._part(COMMAND)
            start.cast("Q")[0] = 2**64 - 1
            zero = np.zeros(12)
            command = JointCommand(
                sequence=1,
                timestamp=1,
                mode=JointMode.DAMPING,
                target_position=zero,
                stiffness=zero,
                damping=zero,
                feedforward_torque=zero,
            )
            interface._put(COMMAND, encode(command))
            assert endpoint._take(COMMAND) == encode(command)
        finally:
            interface.close()
    finally:
        endpoint.close()
