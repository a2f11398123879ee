"""A bus that speaks Unitree's messages: how states are numbered, who is overheard, 500 messages a second."""

import contextlib
import os
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace
from typing import ClassVar

import msgspec
import numpy as np
import pytest

from sprintlab.core.errors import SprintlabError
from sprintlab.deployment.bus import BusError, open_bus, open_endpoint
from sprintlab.deployment.bus.unitree_ends import RESPONSE_TIME, TickNumbers
from sprintlab.deployment.bus.unitree_messages import encode_command
from sprintlab.deployment.interface import JointCommand, JointMode, RobotStatus, encode

MILLISECOND = 1_000_000
SESSION = 77


@pytest.fixture
def ends(unitree_loopback):
    return unitree_loopback(SESSION)


@pytest.fixture
def state_at(make_state):
    """A state at a time of the robot's clock [ms]."""

    def build(milliseconds, **changes):
        return msgspec.structs.replace(
            make_state(milliseconds), timestamp=milliseconds * MILLISECOND, **changes
        )

    return build


@pytest.fixture
def command_at(make_joint_command):
    """A command at a time of the controller's clock [ms]."""

    def build(sequence, milliseconds, mode=JointMode.SERVO):
        whole = make_joint_command(sequence)
        return msgspec.structs.replace(whole, timestamp=milliseconds * MILLISECOND, mode=mode)

    return build


@pytest.mark.parametrize(
    ("ticks", "expected"),
    [
        ([10, 12, 14], [1, 2, 3]),
        ([10, 11, 13, 14], [1, 2, 3, 4]),
        ([10, 12, 12], [1, 2, 2]),
        ([10, 12, 20], [1, 2, 6]),
        ([10, 14, 12, 16], [1, 3, 2, 4]),
        ([10, 12, 11], [1, 2, 1]),
        ([2**32 - 2, 0, 2], [1, 2, 3]),
    ],
)
def test_states_are_numbered_by_the_robots_clock(ticks, expected):
    numbers = TickNumbers()
    assert [numbers.number(tick)[0] - TickNumbers.FIRST + 1 for tick in ticks] == expected


def test_a_reboot_shows_as_old_states_until_somebody_forgets_the_robot():
    numbers = TickNumbers()
    before = [numbers.number(tick) for tick in (90_000, 90_002)][-1]
    after = [numbers.number(tick) for tick in (0, 2, 4)]
    assert all(number < before[0] and stamp < before[1] for number, stamp in after)
    assert after == sorted(after)


@pytest.mark.parametrize("first", [2, 90_000, 2**31 - 1, 2**31, 2**32 - 1])
@pytest.mark.parametrize("back", [1, 3, 89_999, 2**31 - 1, 2**31])
def test_no_clock_of_a_robot_numbers_states_below_zero(first, back, state_at):
    """Neither a log nor a bus has bytes for such a number, and a robot that began anew sends them."""
    numbers = TickNumbers()
    numbers.number(first)
    number, stamp = numbers.number((first - back) % 2**32)
    encode(msgspec.structs.replace(state_at(1), sequence=number, timestamp=stamp))


def test_no_clock_of_a_robot_runs_beyond_what_a_state_can_hold(state_at):
    """A stranger's ticks, each as far ahead as counts as ahead, passed 2^64 ns after 8590 messages."""
    numbers = TickNumbers()
    for jump in range(9000):
        number, stamp = numbers.number(jump * (2**31 - 1) % 2**32)
    encode(msgspec.structs.replace(state_at(1), sequence=number, timestamp=stamp))


def test_500_messages_a_second_go_each_way_from_loops_of_1000(ends, state_at, command_at):
    interface, endpoint = ends
    states = commands = 0
    for moment in range(1, 101):
        assert endpoint.publish(state_at(moment)) == (moment % 2 == 1)
        states += interface.receive() is not None
        interface.send(command_at(moment, moment))
        commands += endpoint.receive_command() is not None
    assert states == commands == 50


def test_a_change_of_mode_or_status_goes_at_once(ends, state_at, command_at):
    interface, endpoint = ends
    interface.send(command_at(1, 1))
    interface.send(command_at(2, 2, JointMode.DAMPING))
    modes = [endpoint.receive_command().mode, endpoint.receive_command().mode]
    assert modes == [JointMode.SERVO, JointMode.DAMPING]
    endpoint.publish(state_at(9))
    assert endpoint.publish(state_at(10, status=int(RobotStatus.WATCHDOG_EXPIRED)))
    assert endpoint.publish(state_at(1, status=int(RobotStatus.WATCHDOG_EXPIRED)))  # its clock began anew


def test_every_state_is_answered(ends, state_at, command_at):
    """A state comes early when the robot's status changes, and a robot in lock-step waits for its answer."""
    interface, endpoint = ends
    for moment, status in ((1, RobotStatus.WATCHDOG_EXPIRED), (2, RobotStatus.READY)):
        endpoint.publish(state_at(moment, status=int(status)))
        assert interface.receive() is not None
        interface.send(command_at(moment, moment))
        assert endpoint.receive_command().state_sequence == moment


def test_a_command_counts_as_obeyed_after_the_response_time(ends, state_at, command_at):
    interface, endpoint = ends
    for number in range(1, 11):
        interface.send(command_at(number, 2 * number))
        endpoint.publish(state_at(2 * number))
        state = interface.receive()
        assert state.command_sequence == max(number - RESPONSE_TIME // (2 * MILLISECOND), 0)
        assert state.session == (SESSION if state.command_sequence else 0)


def test_the_robot_numbers_commands_and_answers_with_its_newest_state(ends, state_at, command_at):
    interface, endpoint = ends
    endpoint.publish(state_at(41))
    interface.send(command_at(900, 2))
    interface.send(command_at(901, 4))
    got = [endpoint.receive_command(), endpoint.receive_command()]
    assert [command.sequence for command in got] == [1, 2]
    assert {command.state_sequence for command in got} == {41}


def test_positions_are_not_sent(ends, make_fix):
    interface, endpoint = ends
    endpoint.publish_fix(make_fix(1))
    assert interface.receive_fix() is None and interface.receive() is None


def stranger_sends(interface, content):
    interface._put("others' command", content)


def test_a_strangers_command_makes_the_next_state_one_of_another_session(ends, state_at, command_at):
    interface, endpoint = ends
    for content in (encode_command(command_at(1, 1)), b"not even a command"):
        stranger_sends(interface, content)
        endpoint.publish(state_at(10 * interface.overheard + 10))
        state = interface.receive()
        assert state.session not in (0, SESSION)
    assert interface.overheard == 2
    endpoint.publish(state_at(100))
    assert interface.receive().foreign_commands == 2


def test_a_flood_of_others_commands_does_not_hold_the_controller(ends, state_at, monkeypatch):
    interface, endpoint = ends
    endpoint.publish(state_at(10))
    take, flood = interface._take, iter([b"x"] * 100_000)
    monkeypatch.setattr(
        interface, "_take", lambda channel: next(flood) if channel == "command" else take(channel)
    )
    assert interface.receive().session not in (0, SESSION)
    assert interface.overheard < 100


def test_a_state_that_is_not_judged_does_not_hide_a_stranger(ends, state_at, command_at):
    """The first state after his command may come twice, or be old: it is dropped, and the next must tell."""
    interface, endpoint = ends
    endpoint.publish(state_at(100))
    interface.receive()
    stranger_sends(interface, encode_command(command_at(1, 1)))
    answers = []
    for moment in (100, 98, 102):
        endpoint._last = None
        endpoint.publish(state_at(moment))
        answers.append(interface.receive())
    first = answers[0].sequence
    assert [state.sequence - first for state in answers] == [0, -1, 1]
    assert all(state.session not in (0, SESSION) for state in answers)
    for moment in range(104, 150, 2):
        interface.send(command_at(moment, moment))
        endpoint.publish(state_at(moment))
        state = interface.receive()
    assert state.session == SESSION


def test_a_stranger_is_still_told_of_when_a_controller_judges_no_state_for_30_ms(ends, state_at, command_at):
    """Longer ends the run by itself (``state-stale``)."""
    interface, endpoint = ends
    interface.send(command_at(1, 100))
    stranger_sends(interface, encode_command(command_at(1, 1)))
    for moment in range(102, 132, 2):
        endpoint._last = None
        endpoint.publish(state_at(100))  # the same once more: it is dropped
        interface.receive()
        interface.send(command_at(moment, moment))
    endpoint.publish(state_at(132))
    assert interface.receive().session not in (0, SESSION)


def test_a_stranger_who_speaks_for_the_robot_too_does_not_hide(ends, state_at, command_at):
    """States that skip a stretch of the robot's clock, or come often, are of the stranger's making."""
    interface, endpoint = ends
    endpoint.publish(state_at(100))
    interface.receive()
    interface.send(command_at(1, 100))
    stranger_sends(interface, encode_command(command_at(1, 1)))
    for moment in (*[100] * 30, 140, 500):
        endpoint._last = None
        endpoint.publish(state_at(moment))
        assert interface.receive().session not in (0, SESSION)


def test_a_stranger_stops_a_run(running, unitree_loopback, continue_on_unitree):
    running.bus = unitree_loopback(running.controller.session)
    continue_on_unitree(running, *running.bus)
    assert running.run(0.1).mode == "run"
    stranger_sends(running.bus[0], encode_command(running.ticks[-1].command))
    running.run_until(lambda tick: tick.command.mode == JointMode.DAMPING, 0.0021)
    assert running.controller.stop_reason == "commands-foreign"


def test_commands_that_nobody_reads_stop_a_run(running, unitree_loopback, continue_on_unitree, monkeypatch):
    running.bus = interface, endpoint = unitree_loopback(running.controller.session)
    continue_on_unitree(running, interface, endpoint)
    monkeypatch.setattr(type(interface), "read_by_robot", property(lambda end: False))
    running.run_until(lambda tick: tick.command.mode == JointMode.DAMPING, 0.103)
    assert running.controller.stop_reason == "commands-unanswered"


def test_a_robot_that_nobody_speaks_to_is_woken_and_stands_up(make_rig, unitree_loopback):
    """Through the messages from the first one on: stopped motors obey once a harmless command has come."""
    rig = make_rig()
    rig.bus = unitree_loopback(rig.controller.session)
    first = rig.step()
    assert first.state.status == RobotStatus.WATCHDOG_EXPIRED
    rig.run_until(lambda tick: tick.mode == "stand", 6.0)
    assert rig.simulated.fall_reason == "" and rig.controller.stop_reason == ""


# ---- over DDS -----------------------------------------------------------------------------------------


@pytest.fixture
def address():
    pytest.importorskip("cyclonedds")
    return f"unitree://go2@:{100 + os.getpid() % 100}"


def until(look):
    deadline = time.monotonic() + 10.0
    while time.monotonic() < deadline:
        if found := look():
            return found
        time.sleep(0.002)
    raise AssertionError("nothing came")


def test_a_stranger_on_the_network_is_overheard(address, state_at, command_at):
    """Unitree's own motion service would be such a one."""
    from sprintlab.deployment.bus.address import parse_address
    from sprintlab.deployment.bus.unitree_bus import UnitreeInterface

    class Stranger(UnitreeInterface):
        def _greet(self, address):
            """Look at nobody."""

        def _give_way(self, address):
            """To nobody."""

    endpoint = open_endpoint(address)
    interface = open_bus(address, session=SESSION)
    stranger = Stranger(parse_address(address), SESSION)
    clock = iter(range(1, 10**6))
    try:

        def look():
            moment = 2 * next(clock)
            stranger.send(command_at(moment, moment))
            interface.send(command_at(moment, moment))
            endpoint.publish(state_at(moment))
            state = interface.receive()
            return state is not None and state.session not in (0, SESSION)

        assert until(look)
        assert interface.overheard > 0
        authors = set()

        def look_for_two():
            look()
            command = endpoint.receive_command()
            if command is not None:
                authors.add(command.session)
            return len(authors) == 2

        assert until(look_for_two)
    finally:
        for end in (stranger, interface, endpoint):
            end.close()


class Open:
    """A lock that keeps nobody out, as that of another machine."""

    def __init__(self, *names):
        """For everybody."""

    def release(self):
        """Nothing."""


@pytest.mark.parametrize("locked", [True, False], ids=["one-machine", "several"])
def test_of_controllers_that_saw_nobody_in_the_same_moment_one_stays(address, monkeypatch, locked):
    """Each has looked before another could be seen; without the lock, as if on machines of their own."""
    from sprintlab.deployment.bus import unitree_bus

    if not locked:
        monkeypatch.setattr(unitree_bus, "ControllerLock", Open)
    endpoint, together = open_endpoint(address), threading.Barrier(3)
    greet = unitree_bus.UnitreeInterface._refuse_others

    def refuse_others(end, *found):
        greet(end, *found)
        if not end._writers and not locked:
            together.wait(60.0)

    monkeypatch.setattr(unitree_bus.UnitreeInterface, "_refuse_others", refuse_others)

    def start(_):
        try:
            return open_bus(address)
        except BusError as error:
            assert "another controller drives the robot" in str(error)
            return None

    with ThreadPoolExecutor(3) as threads:
        found = [bus for bus in threads.map(start, range(3)) if bus is not None]
    endpoint.close()
    for bus in found:
        bus.close()
    assert len(found) == 1


def test_who_comes_later_is_refused_before_he_can_speak(address, monkeypatch):
    """Whatever the keys say, by which two are told apart that come at once."""
    from sprintlab.deployment.bus import unitree_bus

    def speak(*_):
        raise AssertionError("he was let in")

    with contextlib.closing(open_endpoint(address)) as endpoint:
        with contextlib.closing(open_bus(address)):
            assert not endpoint.peer_left
            monkeypatch.setattr(unitree_bus, "ControllerLock", Open)
            monkeypatch.setattr(unitree_bus._DdsEnd, "_writer", speak)
            for come, said in ((open_bus, "another controller"), (open_endpoint, "a robot is there already")):
                with pytest.raises(BusError, match=said):
                    come(address)
        until(lambda: endpoint.peer_left)


def test_what_holds_no_message_is_passed_over(address):
    """The library hands out such a thing when a writer takes its message back."""
    from sprintlab.deployment.bus import unitree_bus

    whole = unitree_bus._PACKETS["state"].deserialize(b"whole")
    whole.sample_info = SimpleNamespace(publication_handle=1)
    with contextlib.closing(open_endpoint(address)) as endpoint:
        endpoint._waiting["command"] += [SimpleNamespace(sample_info=whole.sample_info), whole]
        assert endpoint._take("command") == b"whole"


def test_its_own_commands_are_not_overheard(address, state_at, command_at):
    endpoint, interface = open_endpoint(address), open_bus(address, session=SESSION)
    heard = 0
    try:
        for number in range(1, 100):
            interface.send(command_at(number, 2 * number))
            endpoint.publish(state_at(2 * number))
            until(lambda: interface.receive() is not None or interface.read_by_robot is False)
            heard += endpoint.receive_command() is not None
        assert heard > 50 and interface.overheard == 0
    finally:
        interface.close()
        endpoint.close()


PLACES = ["lo:x", "lo:231", "no-such-interface:230", "lo:" + "1" * 5000, "lo:\u0663", 'lo"><x>', "x" * 3000]


@pytest.mark.parametrize("place", PLACES, ids=lambda place: place[:10])
def test_a_place_that_is_none_is_refused(place):
    pytest.importorskip("cyclonedds")
    with pytest.raises(BusError, match=r"DDS domain|network interface") as refusal:
        open_endpoint(f"unitree://go2@{place}")
    assert len(str(refusal.value)) < 200


def test_strangers_cannot_be_kept_out_and_that_is_said(tmp_path):
    pytest.importorskip("cyclonedds")
    with pytest.raises(SprintlabError, match="cannot keep strangers out"):
        open_bus("unitree://go2", config=tmp_path / "zenoh.json5")


def test_a_command_of_another_sender_is_a_joint_command(ends, command_at):
    interface, endpoint = ends
    interface.send(command_at(3, 2))
    command = endpoint.receive_command()
    assert isinstance(command, JointCommand) and np.isfinite(command.target_position).all()


def test_of_robots_that_saw_nobody_in_the_same_moment_one_stays(address, monkeypatch):
    """Two that publish states at once would be one robot to a controller, with the joints of both."""
    from sprintlab.deployment.bus import unitree_bus

    open_endpoint(address).close()  # a process joins a domain once, and not in several threads
    together = threading.Barrier(3)
    publishers = unitree_bus.UnitreeEndpoint._publishers

    def seen(end, channel):
        found = publishers(end, channel)
        if not getattr(end, "_writers", None):
            together.wait(60.0)
        return found

    monkeypatch.setattr(unitree_bus.UnitreeEndpoint, "_publishers", seen)

    def start(_):
        try:
            return open_endpoint(address)
        except BusError as error:
            assert "a robot is there already" in str(error)
            return None

    with ThreadPoolExecutor(3) as threads:
        found = [end for end in threads.map(start, range(3)) if end is not None]
    for end in found:
        end.close()
    assert len(found) == 1


STRANGER = """
import sys
from cyclonedds.core import Policy, Qos
from cyclonedds.pub import DataWriter, Publisher
from cyclonedds.topic import Topic
from sprintlab.deployment.bus import unitree_bus
from sprintlab.deployment.bus.address import parse_address

class NoText(str):
    def encode(self, *_):
        return b"\\xff\\xfe"

participant = unitree_bus._participant(parse_address(sys.argv[1]))
qualities = {"name": Qos(Policy.EntityName(NoText("x"))), "nothing": Qos()}
partition = Publisher(participant, qos=Qos(Policy.Partition([NoText("x")])))
topic = Topic(participant, sys.argv[3], unitree_bus._PACKETS[sys.argv[4]])
writer = DataWriter(partition if sys.argv[2] == "partition" else participant, topic,
                    qos=qualities.get(sys.argv[2], Qos()))
print("up", flush=True)
sys.stdin.readline()
"""


@contextlib.contextmanager
def strangers_writer(address, *arguments):
    """A process that announces a DDS publisher with a name that is not UTF-8."""
    stranger = subprocess.Popen(
        [sys.executable, "-c", STRANGER, address, *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert stranger.stdout.readline() == "up\n"
        yield
    finally:
        stranger.communicate("\n")


@pytest.mark.parametrize("where", ["name", "partition"])
def test_an_announcement_that_is_no_text_keeps_nobody_out(address, where):
    """The library gave up, and with it both ends, at whatever topic it came."""
    with strangers_writer(address, where, "rt/other", "state"):
        endpoint = open_endpoint(address)
        open_bus(address).close()
        endpoint.close()


def test_who_announces_himself_with_what_is_no_text_is_seen_all_the_same(address):
    with (
        contextlib.closing(open_endpoint(address)),
        strangers_writer(address, "name", "rt/lowcmd", "command"),
        pytest.raises(BusError, match="another controller"),
    ):
        open_bus(address)


def test_publishers_are_found_beside_one_whose_topic_has_no_name():
    pytest.importorskip("cyclonedds")
    from sprintlab.deployment.bus import unitree_bus

    class Reader:
        """Gives up what it has taken, as the library does."""

        waiting: ClassVar = ["first", None, "last"]

        def take(self, N):
            taken, self.waiting = self.waiting[:N], self.waiting[N:]
            if None in taken:
                raise Exception("Callfunc endpoint constructor errored.")
            return taken

    assert list(unitree_bus._everybody(Reader())) == ["first", "last"]
