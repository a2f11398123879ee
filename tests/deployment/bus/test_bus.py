"""Every bus keeps the same promises; shared memory also survives crashes."""

import os
import signal
import socket
import subprocess
import sys
import time

import pytest

from sprintlab.core.errors import InvalidValueError
from sprintlab.deployment.bus import BusError, open_bus, open_endpoint, parse_address
from sprintlab.deployment.bus.shared_memory import PREFIX, remove_orphans, shared_folder

PATIENCE = 5.0


@pytest.fixture(params=["shm", "zenoh", "dds"])
def address(request, bus_name):
    if request.param == "shm":
        return f"shm://{bus_name}"
    if request.param == "zenoh":
        pytest.importorskip("zenoh")
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            return f"zenoh://{bus_name}@127.0.0.1:{free.getsockname()[1]}"
    pytest.importorskip("cyclonedds")
    return f"dds://{bus_name}@{100 + os.getpid() % 100}"


@pytest.fixture
def ends(address):
    endpoint = open_endpoint(address)
    try:
        interface = open_bus(address)
        try:
            yield interface, endpoint
        finally:
            interface.close()
    finally:
        endpoint.close()


def eventually(look):
    """What ``look`` gives once it gives something."""
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        found = look()
        if found is not None and found is not False:
            return found
        time.sleep(0.001)
    raise AssertionError("nothing came")


def connected(interface, endpoint, make_state):
    """Publish until something arrives: a middleware needs a moment to match its ends."""

    def look():
        endpoint.publish(make_state(1))
        return interface.receive()

    eventually(look)
    time.sleep(0.1)
    while interface.receive() is not None:
        pass


def test_states_arrive_in_order_and_unchanged(ends, make_state):
    interface, endpoint = ends
    connected(interface, endpoint, make_state)
    for sequence in range(2, 52):
        endpoint.publish(make_state(sequence))
        state = eventually(interface.receive)
        assert (state.sequence, state.timestamp) == (sequence, 1000 * sequence)
        assert state.joint_position.tolist() == [float(sequence)] * 12
    assert interface.receive() is None
    assert interface.malformed == 0


def test_commands_and_fixes_arrive(ends, make_state, make_joint_command, make_fix):
    interface, endpoint = ends
    connected(interface, endpoint, make_state)

    def look():
        interface.send(make_joint_command(3))
        return endpoint.receive_command()

    command = eventually(look)
    assert command.sequence == 3
    assert command.stiffness.tolist() == [100.0] * 12
    for sequence in (1, 2, 3):
        endpoint.publish_fix(make_fix(sequence))
    time.sleep(0.2)
    endpoint.publish(make_state(2))  # when it has arrived, what was sent before it has
    eventually(interface.receive)
    fix = eventually(interface.receive_fix)
    assert fix.sequence == 3  # the newest; older ones are passed over
    assert interface.receive_fix() is None


def test_a_second_controller_and_a_second_robot_are_refused(ends, address):
    with pytest.raises(BusError, match="another controller"):
        open_bus(address)
    with pytest.raises(BusError, match=r"already|in use"):
        open_endpoint(address)


def test_each_end_learns_that_the_other_has_left(ends, make_state):
    interface, endpoint = ends
    connected(interface, endpoint, make_state)
    assert not interface.peer_left
    eventually(lambda: endpoint.peer_left is False)
    interface.close()
    interface.close()
    eventually(lambda: endpoint.peer_left)


def test_without_a_robot_there_is_no_bus(address):
    with pytest.raises(BusError, match="robot"):
        open_bus(address)


@pytest.mark.parametrize("wrong", ["bp2", "shm:/bp2", "shm://", "shm://a b", "tcp://bp2", "shm://../x"])
def test_an_address_that_makes_no_sense_is_refused(wrong):
    with pytest.raises(InvalidValueError, match="bus"):
        parse_address(wrong)


def test_shared_memory_has_no_place():
    with pytest.raises(BusError, match="this machine"):
        open_endpoint("shm://bp2@127.0.0.1:1")


def test_a_missing_package_is_named_with_its_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "zenoh", None)
    monkeypatch.delitem(sys.modules, "sprintlab.deployment.bus.zenoh_bus", raising=False)
    with pytest.raises(BusError, match=r"sprintlab\[zenoh\]"):
        open_bus("zenoh://bp2")


def test_the_robot_removes_its_memory(bus_name):
    endpoint = open_endpoint(f"shm://{bus_name}")
    path = shared_folder() / f"{PREFIX}{bus_name}"
    assert path.exists()
    endpoint.close()
    assert not path.exists()


def test_a_new_robot_takes_the_place_of_one_that_crashed(bus_name):
    code = f"""
import sys
from sprintlab.deployment.bus import open_endpoint
endpoint = open_endpoint("shm://{bus_name}")
print("up", flush=True)
sys.stdin.read()
"""
    robot = subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert robot.stdout is not None
    assert robot.stdout.readline() == b"up\n"
    with pytest.raises(BusError, match="already"):
        open_endpoint(f"shm://{bus_name}")
    robot.send_signal(signal.SIGKILL)
    robot.communicate()
    path = shared_folder() / f"{PREFIX}{bus_name}"
    assert path.exists()
    with pytest.raises(BusError, match="crashed"):
        open_bus(f"shm://{bus_name}")
    endpoint = open_endpoint(f"shm://{bus_name}")
    interface = open_bus(f"shm://{bus_name}")
    interface.close()
    endpoint.close()
    assert not path.exists()


def test_orphans_are_removed_and_the_living_left_alone(tmp_path):
    import fcntl

    (tmp_path / f"{PREFIX}dead").write_bytes(b"0")
    (tmp_path / "other").write_bytes(b"0")
    living = tmp_path / f"{PREFIX}living"
    with living.open("wb") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        assert remove_orphans(tmp_path) == ["dead"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["other", f"{PREFIX}living"]


def test_a_damaged_message_is_dropped_and_counted(bus_name, make_state):
    endpoint = open_endpoint(f"shm://{bus_name}")
    interface = open_bus(f"shm://{bus_name}")
    endpoint.publish(make_state(1))
    interface._readers["state"]._memory[100] ^= 1
    endpoint.publish(make_state(2))
    state = interface.receive()
    assert state is not None and state.sequence == 2
    assert interface.malformed == 1
    interface.close()
    endpoint.close()
