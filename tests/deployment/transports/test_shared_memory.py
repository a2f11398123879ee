"""Shared memory between a robot and its one controller, which also survives crashes."""

import contextlib
import signal
import subprocess
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.deployment.messages import make_command, make_fix, make_state

from sprintlab.core.errors import SprintlabError
from sprintlab.deployment.transports import (
    leaves_this_machine,
    open_bus,
    open_endpoint,
)
from sprintlab.deployment.transports.shared_memory import Ring, memory_path

SLOTS = 8


@given(st.lists(st.integers(0, 12), max_size=20))
def test_messages_come_in_order_and_the_newest_of_every_burst_arrive(bursts):
    memory = memoryview(bytearray(Ring.size(SLOTS)))
    writer, reader, written = Ring(memory, SLOTS), Ring(memory, SLOTS), 0
    for burst in bursts:
        for _ in range(burst):
            writer.write(written.to_bytes(21, "little"))
            written += 1
        got = [int.from_bytes(content, "little") for content in iter(reader.read, None)]
        assert got == list(range(written - min(burst, SLOTS - 1), written))
    with pytest.raises(ValueError, match="a slot has"):
        writer.write(bytes(2000))
    assert reader.read() is None


def test_a_message_that_changes_while_it_is_copied_is_dropped(monkeypatch):
    memory = memoryview(bytearray(Ring.size(SLOTS)))
    writer, reader = Ring(memory, SLOTS), Ring(memory, SLOTS)
    writer.write(b"torn")
    writer.write(b"overwritten")

    class Racing:
        """Memory in which the writer overtakes during the copy of the first message."""

        done = False

        def __getitem__(self, part):
            if not self.done:
                self.done = True
                for number in range(100, 100 + SLOTS):
                    writer.write(b"%d" % number)
            return memory[part]

    monkeypatch.setattr(reader, "_memory", Racing())
    assert reader.read() == b"101"  # 100 was about to be overwritten


@pytest.fixture
def address(bus_name):
    return f"shm://{bus_name}"


@pytest.fixture
def path(bus_name):
    return memory_path(bus_name)


@pytest.fixture
def ends(address):
    with (
        contextlib.closing(open_endpoint(address)) as endpoint,
        contextlib.closing(open_bus(address)) as interface,
    ):
        yield interface, endpoint


def test_states_commands_and_the_newest_fix_arrive(ends):
    interface, endpoint = ends
    for sequence in range(1, 51):
        assert endpoint.publish(make_state(sequence))
        interface.send(make_command(sequence))
        endpoint.publish_fix(make_fix(sequence))
    states, commands = list(iter(interface.receive, None)), list(iter(endpoint.receive_command, None))
    numbers = list(range(1, 51))
    assert [state.sequence for state in states] == [command.sequence for command in commands] == numbers
    assert states[6].joint_position.tolist() == [7e-3] * 12 and commands[6].stiffness.tolist() == [100.0] * 12
    assert interface.receive_fix().sequence == 50 and interface.receive_fix() is None


def test_a_damaged_message_is_dropped_and_its_reason_counted(ends):
    interface, endpoint = ends
    endpoint.carrier.put("state", b"no state at all")
    endpoint.publish(make_state(2))
    assert interface.receive().sequence == 2
    assert dict(interface.refused) == {"a RobotState came damaged: its checksum does not fit": 1}


def test_a_second_controller_and_a_second_robot_are_refused(ends, address):
    with pytest.raises(SprintlabError, match="another controller"):
        open_bus(address)
    with pytest.raises(SprintlabError, match="already"):
        open_endpoint(address)


def test_each_end_learns_that_the_other_has_left_and_no_file_remains(address, path):
    with contextlib.closing(open_endpoint(address)) as endpoint:
        open_bus(address).close()
        assert endpoint.peer_left
        interface = open_bus(address)
        assert not endpoint.peer_left and not interface.peer_left
    assert interface.peer_left
    interface.close()
    interface.close()
    assert not list(path.parent.glob(f"{path.name}*"))


def test_a_new_robot_takes_the_place_of_one_that_crashed(address, path):
    code = f"""
import sys
from sprintlab.deployment.transports import open_endpoint
endpoint = open_endpoint("{address}")
print("up", flush=True)
sys.stdin.read()
"""
    robot = subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert robot.stdout.readline() == b"up\n"
    with pytest.raises(SprintlabError, match="already"):
        open_endpoint(address)
    robot.send_signal(signal.SIGKILL)
    robot.communicate()
    assert path.exists()
    with pytest.raises(SprintlabError, match="no robot named"):
        open_bus(address)
    with (
        contextlib.closing(open_endpoint(address)) as end,
        contextlib.closing(open_bus(address)) as interface,
    ):
        end.publish(make_state(1))
        assert interface.receive().sequence == 1
    assert not path.exists()


@pytest.mark.parametrize(
    ("address", "leaves"),
    [("shm://a", False), ("unitree://a", False), ("unitree://a@lo:7", False), ("unitree://a@enp2s0", True)],
)
def test_only_a_network_interface_leads_beyond_this_machine(address, leaves):
    assert leaves_this_machine(address) is leaves
