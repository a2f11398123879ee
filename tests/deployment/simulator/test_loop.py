"""A simulated robot on a bus: at the pace of the clock, and waiting for the answer to each of its states."""

from collections import Counter
from types import SimpleNamespace

import pytest
from tests.deployment.messages import make_command, make_fix, make_state

from sprintlab.core.errors import SprintlabError
from sprintlab.deployment.interface import JointMode, RobotStatus
from sprintlab.deployment.simulator import (
    LinkOptions,
    PaceOptions,
    SimulatedWorld,
    SimulatorOptions,
    loop,
    run_simulator,
)
from sprintlab.robots import load_robot

ROBOT = load_robot("bp2")


class Endpoint:
    """A robot's end at which commands wait. What is published is lost, or answered from some message on."""

    peer_left, ready = False, True

    def __init__(self, *waiting, lost=10**6):
        self.waiting, self.lost, self.published, self.fixes = list(waiting), lost, [], []
        self.refused = Counter()

    def receive_command(self):
        return self.waiting.pop(0) if self.waiting else None

    def publish(self, state):
        self.published.append(state.sequence)
        if len(self.published) > self.lost:
            self.waiting.append(SimpleNamespace(state_sequence=state.sequence))
        return True

    def publish_fix(self, fix):
        self.fixes.append(fix.sequence)


def damping(sequence):
    return make_command(sequence, mode=JointMode.DAMPING)


@pytest.fixture
def moment(monkeypatch):
    """The time of a simulated robot's loop [s], in a list: a test lets it pass."""
    now = [100.0]
    clock = SimpleNamespace(
        monotonic=lambda: now[0], monotonic_ns=lambda: round(1e9 * now[0]), sleep=lambda seconds: None
    )
    monkeypatch.setattr(loop, "time", clock)
    return now


def world_of(**options):
    return SimulatedWorld(ROBOT, SimulatorOptions(start="standing", **options))


def test_a_robot_that_was_stopped_does_nothing_of_what_was_sent_before(moment):
    """A process that stood still for longer than the watchdog: its commands are old, the safe ones too."""
    delayed = LinkOptions(delay=0.003)
    world, endpoint = world_of(to_robot=delayed), Endpoint(damping(1), make_command(2))
    run = loop._RealTime(world, endpoint, PaceOptions(), lambda: False)

    def live(seconds):
        moment[0] += seconds
        run.exchange()
        world.step()
        return world.robot.state(0).status

    for _ in range(5):
        status = live(0.001)
    assert status == RobotStatus.READY and world.robot.accepted == 2
    endpoint.waiting = [make_command(3)]
    live(0.001)  # on its way
    endpoint.waiting = [damping(number) if number == 50 else make_command(number) for number in range(4, 250)]
    assert live(5.0) == RobotStatus.WATCHDOG_EXPIRED
    for _ in range(20):
        assert live(0.001) == RobotStatus.WATCHDOG_EXPIRED
    assert (world.robot.accepted, world.robot.dropped.total(), world.robot.watchdog_trips) == (2, 247, 1)
    assert run.report.given_up == pytest.approx(5.0, abs=0.01)
    endpoint.waiting = [damping(250)]
    assert [live(0.001) for _ in range(5)][-1] == RobotStatus.READY


def test_each_reason_for_a_dropped_command_is_told_once_and_counted():
    """A command that the bus could not decode is one, too."""
    told, expired = [], "the watchdog has expired: only a damping or off command is taken first"
    endpoint = Endpoint(*(make_command(number) for number in range(1, 151)))
    endpoint.refused["a LowCmd_ came damaged: its checksum does not fit"] = 7
    pace = PaceOptions(duration=0.3, speed_factor=100.0)
    report = run_simulator(world_of(), endpoint, pace, remark=told.append)
    assert report.drop_reasons[expired] == 150 and report.commands_dropped == 157
    assert sorted(told) == sorted(f"a command was dropped: {reason}" for reason in report.drop_reasons)
    assert report.simulated_time == pytest.approx(0.3) and len(endpoint.published) == 300


class World:
    """Messages that wait, and the answers to them."""

    time, robot = 0.0, SimpleNamespace(plant=SimpleNamespace(options=SimpleNamespace(motor_rate=1000.0)))

    def __init__(self, *messages):
        self.waiting, self.commands = list(messages), []

    def messages(self, timestamp):
        return self.waiting

    def hand_over(self, command):
        self.commands.append(command)


@pytest.fixture
def lock_step(monkeypatch):
    """Makes a robot in lock-step, not a patient one."""
    monkeypatch.setattr(loop, "_ASK_AGAIN", 0.01)
    monkeypatch.setattr(loop, "_SECOND_THOUGHT", 0.01)
    pace = PaceOptions(lock_step=True, patience=0.1)
    return lambda world, endpoint: loop._LockStep(world, endpoint, pace, lambda: False)


def test_a_state_that_was_lost_is_sent_again_and_a_fix_is_not(lock_step):
    """The controller takes a fix that came twice for an old one, which is a fault."""
    world, endpoint = World(make_fix(4), make_state(1)), Endpoint(lost=2)
    assert lock_step(world, endpoint).exchange()
    assert endpoint.published == [1] * 3 and endpoint.fixes == [4]
    assert len(world.commands) == 1


def test_a_robot_that_is_not_answered_gives_up(lock_step):
    """An answer to a state that was not sent yet does not let it run free."""
    run = lock_step(World(make_state(1)), Endpoint(make_command(1, state_sequence=5001)))
    assert run.exchange()  # it answered, but does not accept this state
    with pytest.raises(SprintlabError, match="has not answered"):
        run.exchange()
