"""A bus that speaks Unitree's messages: how states are numbered, who is overheard, 500 messages a second."""

import contextlib
import os
import time
from collections import deque

import pytest
from tests.deployment.messages import make_command, make_state

from sprintlab.core.errors import SprintlabError
from sprintlab.deployment.messages import JointMode, RobotStatus
from sprintlab.deployment.transports import open_bus, open_endpoint, parse_address
from sprintlab.deployment.transports.unitree_ends import RESPONSE_TIME, TickNumbers
from sprintlab.deployment.transports.unitree_messages import encode_command

MILLISECOND = 1_000_000
SESSION = 77


@pytest.fixture
def ends(unitree_loopback):
    return unitree_loopback(SESSION)


def state_at(milliseconds, **changes):
    """A state at a time of the robot's clock [ms]."""
    return make_state(milliseconds, timestamp=milliseconds * MILLISECOND, **changes)


def command_at(sequence, milliseconds, mode=JointMode.SERVO):
    """A command at a time of the controller's clock [ms]."""
    return make_command(sequence, timestamp=milliseconds * MILLISECOND, mode=mode, session=SESSION)


@pytest.mark.parametrize(
    ("ticks", "expected"),
    [
        ([10, 12, 20], [1, 2, 6]),
        ([10, 14, 12, 16], [1, 3, 2, 4]),
        ([2**32 - 2, 0, 2], [1, 2, 3]),
    ],
)
def test_states_are_numbered_by_the_robots_clock(ticks, expected):
    numbers = TickNumbers()
    assert [numbers.number(tick)[0] - TickNumbers.FIRST + 1 for tick in ticks] == expected


def test_500_messages_a_second_go_each_way_from_loops_of_1000(ends):
    interface, endpoint = ends
    states = commands = 0
    for moment in range(1, 101):
        assert endpoint.publish(state_at(moment)) == (moment % 2 == 1)
        states += interface.receive() is not None
        interface.send(command_at(moment, moment))
        commands += endpoint.receive_command() is not None
    assert states == commands == 50


def test_a_change_of_mode_or_status_goes_at_once(ends):
    interface, endpoint = ends
    interface.send(command_at(1, 1))
    interface.send(command_at(2, 2, JointMode.DAMPING))
    modes = [endpoint.receive_command().mode, endpoint.receive_command().mode]
    assert modes == [JointMode.SERVO, JointMode.DAMPING]
    endpoint.publish(state_at(9))
    assert endpoint.publish(state_at(10, status=int(RobotStatus.WATCHDOG_EXPIRED)))
    assert endpoint.publish(state_at(1, status=int(RobotStatus.WATCHDOG_EXPIRED)))  # its clock began anew


def test_every_state_is_answered_and_commands_are_numbered_as_they_come(ends):
    """A state comes early when the robot's status changes, and a robot in lock-step waits for its answer."""
    interface, endpoint = ends
    for moment, status in ((1, RobotStatus.WATCHDOG_EXPIRED), (2, RobotStatus.READY)):
        endpoint.publish(state_at(moment, status=int(status)))
        assert interface.receive() is not None
        interface.send(command_at(900 + moment, moment))
        command = endpoint.receive_command()
        assert (command.sequence, command.state_sequence) == (moment, moment)


def test_a_command_counts_as_obeyed_after_the_response_time(ends):
    interface, endpoint = ends
    for number in range(1, 11):
        interface.send(command_at(number, 2 * number))
        endpoint.publish(state_at(2 * number))
        state = interface.receive()
        assert state.command_sequence == max(number - RESPONSE_TIME // (2 * MILLISECOND), 0)
        assert state.session == (SESSION if state.command_sequence else 0)


def test_another_controller_stops_a_run(running_on_unitree):
    """Whatever it sends: the next state is one of another session."""
    rig = running_on_unitree
    assert rig.run(0.1).mode == "run"
    rig.bus[0].carrier.wires["others' command"] = deque([b"not even a command"])
    rig.run_until(lambda tick: tick.command.mode == JointMode.DAMPING, 0.0021)
    assert rig.controller.stop_reason == "commands-foreign"


def test_commands_without_a_reader_stop_a_run(running_on_unitree, monkeypatch):
    monkeypatch.setattr(running_on_unitree.bus[0].carrier, "heard", False)
    running_on_unitree.run_until(lambda tick: tick.command.mode == JointMode.DAMPING, 0.103)
    assert running_on_unitree.controller.stop_reason == "commands-unanswered"


def test_a_robot_before_its_first_command_is_woken_and_stands_up(make_rig, unitree_loopback):
    """Through the messages from the first one on: stopped motors obey once a harmless command has come."""
    rig = make_rig()
    rig.bus = unitree_loopback(rig.controller.session)
    first = rig.step()
    assert first.state.status == RobotStatus.WATCHDOG_EXPIRED
    rig.run_until(lambda tick: tick.mode == "stand", 6.0)
    assert rig.simulated.fall_reason == "" and rig.controller.stop_reason == ""


# ---- over DDS -----------------------------------------------------------------------------------------


@pytest.fixture
def address(monkeypatch):
    """One on which a robot may take its time to be found: the machine is shared."""
    pytest.importorskip("cyclonedds")
    monkeypatch.setattr("sprintlab.deployment.transports.unitree_dds._PATIENCE", 60.0)
    return f"unitree://go2@:{100 + os.getpid() % 100}"


def another_writer(address):
    """A publisher of ``rt/lowcmd``, as Unitree's own motion service would be one."""
    from cyclonedds.pub import DataWriter
    from cyclonedds.topic import Topic

    from sprintlab.deployment.transports import unitree_dds

    participant = unitree_dds._participant(parse_address(address))
    packet = unitree_dds._PACKETS["command"]
    writer = DataWriter(participant, Topic(participant, "rt/lowcmd", packet))
    return writer, lambda content: writer.write(packet.deserialize(content))


def test_another_controller_on_the_network_is_overheard(address):
    with (
        contextlib.closing(open_endpoint(address)) as endpoint,
        contextlib.closing(open_bus(address, session=SESSION)) as interface,
    ):
        _, write = another_writer(address)
        foreign, authors, moment = False, set(), 0
        while not (foreign and len(authors) == 2):  # until the network has connected all of them
            moment += 2
            time.sleep(0.001)
            write(encode_command(command_at(moment, moment)))
            interface.send(command_at(moment, moment))
            endpoint.publish(state_at(moment))
            command, state = endpoint.receive_command(), interface.receive()
            authors.update([] if command is None else [command.session])
            foreign = foreign or (state is not None and state.session not in (0, SESSION))


def test_a_second_robot_and_a_second_controller_are_refused(address):
    with contextlib.closing(open_endpoint(address)) as endpoint:
        with pytest.raises(SprintlabError, match="a robot is there already"):
            open_endpoint(address)
        with contextlib.closing(open_bus(address)), pytest.raises(SprintlabError, match="another controller"):
            assert not endpoint.peer_left
            open_bus(address)
        while not endpoint.peer_left:
            time.sleep(0.001)
        writer, _ = another_writer(address)
        with pytest.raises(SprintlabError, match="publishes rt/lowcmd"):
            open_bus(address)
        assert writer


def test_a_controller_without_a_robot_is_told_so(address, monkeypatch):
    from sprintlab.deployment.transports import unitree_dds

    monkeypatch.setattr(unitree_dds, "_PATIENCE", 0.1)
    with pytest.raises(SprintlabError, match="no robot publishes rt/lowstate"):
        open_bus(address)
