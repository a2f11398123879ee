"""A simulated robot on a bus: at the pace of the clock, and waiting for the answer to each of its states."""

from collections import Counter
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.deployment.clock import FakeClock
from tests.deployment.messages import make_command

from sprintlab.core.errors import SprintlabError
from sprintlab.deployment.simulator import (
    Link,
    LinkOptions,
    SimulatedWorld,
    SimulatorOptions,
    loop,
    run_simulator,
)
from sprintlab.robots import load_robot

ROBOT = load_robot("bp2")
STEP = 0.001


def send(options, count=500, seed=0):
    """Send one message a step; the step at which each one arrived."""
    link, arrived = Link(options, seed), {}
    for step in range(count + 2500):
        if step < count:
            link.push(step * STEP, step)
        for item in link.pop(step * STEP):
            arrived[item] = step
    return arrived


@given(delay=st.floats(0.0, 0.05), jitter=st.floats(0.0, 0.05), seed=st.integers(0, 100))
def test_messages_never_overtake_and_are_neither_early_nor_later_than_the_jitter_allows(delay, jitter, seed):
    arrived = send(LinkOptions(delay=delay, jitter=jitter), count=200, seed=seed)
    steps = [arrived[item] for item in range(200)]
    assert steps == sorted(steps)
    for item, step in arrived.items():
        late = (step - item) * STEP
        assert delay - 1e-5 <= late <= delay + jitter + STEP + 1e-5


def test_the_lost_share_is_as_asked_and_the_seed_decides_which():
    options = LinkOptions(loss=0.2, jitter=0.01)
    arrived = send(options, count=5000)
    assert 0.77 < len(arrived) / 5000 < 0.83
    assert arrived == send(options, count=5000) != send(options, count=5000, seed=5)


class Endpoint:
    """A robot's end at which commands wait, and that is not answered."""

    peer_left, carrier = False, SimpleNamespace(ready=True)

    def __init__(self, *waiting):
        self.waiting, self.published = list(waiting), []
        self.refused = Counter()

    def receive_command(self):
        return self.waiting.pop(0) if self.waiting else None

    def publish(self, state):
        self.published.append(state.sequence)
        return True

    def publish_fix(self, fix):
        """It is lost."""


def world_of(**options):
    return SimulatedWorld(ROBOT, SimulatorOptions(start="standing", **options))


@pytest.mark.parametrize(("extra", "given_up"), [(0.0, 0.0), (0.08, 0.8)])
def test_time_that_cannot_be_made_up_for_is_given_up_and_counted(monkeypatch, extra, given_up):
    """A process that the machine leaves alone for 80 ms, ten times."""
    monkeypatch.setattr(loop, "time", FakeClock(extra))
    report = run_simulator(world_of(), Endpoint(), duration=0.01)
    assert report.simulated_time == pytest.approx(0.01)
    assert report.given_up == pytest.approx(given_up, abs=0.01)


def test_each_reason_for_a_dropped_command_is_told_once_and_counted(monkeypatch):
    """A command that the bus could not decode is one, too."""
    monkeypatch.setattr(loop, "time", FakeClock())
    told, expired = [], "the watchdog has expired: only a damping or off command is taken first"
    endpoint = Endpoint(*(make_command(number) for number in range(1, 151)))
    endpoint.refused["a LowCmd_ came damaged: its checksum does not fit"] = 7
    report = run_simulator(world_of(), endpoint, duration=0.3, remark=told.append)
    assert report.drop_reasons[expired] == 150 and report.commands_dropped == 157
    assert sorted(told) == sorted(f"a command was dropped: {reason}" for reason in report.drop_reasons)
    assert report.simulated_time == pytest.approx(0.3) and len(endpoint.published) == 300


def test_a_robot_in_lock_step_that_is_not_answered_gives_up(monkeypatch):
    monkeypatch.setattr(loop, "time", FakeClock())
    endpoint = Endpoint(make_command(1, state_sequence=0))  # the answer to another state
    with pytest.raises(SprintlabError, match="has not answered"):
        run_simulator(world_of(), endpoint, lock_step=True)
