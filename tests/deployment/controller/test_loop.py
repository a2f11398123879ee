"""The loop on a bus: clock, misses, ends, and the last word to the robot."""

from __future__ import annotations

import itertools
from collections import Counter

import numpy as np
import pytest
from msgspec.structs import replace
from tests.deployment.clock import FakeClock

from sprintlab.deployment.controller import LoopOptions, realtime, run_loop
from sprintlab.deployment.messages import JointMode
from sprintlab.deployment.operators.base import OperatorCommand, Request

MILLISECOND = 1_000_000


class DirectBus:
    """A simulated robot that steps once for every command: a lock-step bus without a bus.

    ``lost`` is the number of a command that does not arrive, ``twice`` that of a state that comes twice;
    ``forged`` are other values in every state.
    """

    silent = peer_left = False
    lost = twice = 0

    def __init__(self, simulated, session):
        self.session, self.simulated, self.refused = session, simulated, Counter({"damaged": 3})
        self.sent, self.forged, self._count = [], {}, itertools.count(1)
        self._state = None
        self._waiting = [self._measure()]

    def _measure(self):
        self._state = self.simulated.state(len(self.sent) * MILLISECOND)
        return self._state

    def receive(self):
        if not self._waiting or self.silent:
            return None
        return replace(self._waiting.pop(0), **self.forged)

    def receive_fix(self):
        return None

    def send(self, command):
        if next(self._count) == self.lost:
            self._waiting = [self._state]
            return
        self.sent.append(command)
        self.simulated.accept(command)
        self.simulated.step()
        self._waiting = [self._measure()]
        if len(self.sent) == self.twice:
            self._waiting *= 2


class Sleeper:
    """Asks for nothing."""

    def read(self, view):
        return None


class Riser:
    """Wants to stand."""

    def read(self, view):
        return OperatorCommand(np.zeros(3), Request.STAND if view.mode == "passive" else Request.NONE)


class Log:
    def __init__(self):
        self.ticks = []

    def write(self, tick):
        self.ticks.append(tick)


@pytest.fixture
def start(lie_down_with, hurried, monkeypatch):
    """Makes a controller and its bus; memory is not locked, since tests have imported gigabytes of it."""
    monkeypatch.setattr(realtime, "_lock_memory", lambda: None)

    def make(source):
        rig = lie_down_with(source)
        return rig.controller, DirectBus(rig.simulated, rig.controller.session)

    return make


@pytest.mark.parametrize("trouble", ["lost", "twice"])
def test_in_lock_step_a_state_is_answered_once_however_often_it_comes(start, trouble):
    """A network may drop an answer, and the robot asks again; a slow controller finds two questions."""
    controller, bus = start(Sleeper())
    setattr(bus, trouble, 50)
    options = LoopOptions(lock_step=True, duration=0.2, attended=True)  # it waits for its operator meanwhile
    report = run_loop(controller, bus, options)
    assert report.end == "passive" and not controller.fault_counts
    assert [command.sequence for command in bus.sent] == list(range(1, report.steps + 2))


def test_in_lock_step_time_is_the_robots(start):
    controller, bus = start(Riser())
    log = Log()
    report = run_loop(controller, bus, LoopOptions(lock_step=True, duration=2.1), log=log)
    assert report.end == "passive" and report.grant is None
    assert report.duration == pytest.approx(5.42, abs=0.1)  # 2.1 seconds, then sinking and damping
    assert report.steps == len(log.ticks) == len(bus.sent) - 1
    assert report.policy_steps == 0 and report.refused == {"damaged": 3}
    assert {tick.mode for tick in log.ticks} == {"passive", "stand-up", "stand", "lie-down"}
    assert bus.sent[-1].mode == JointMode.OFF


def test_a_second_interruption_stops_the_robot_at_once(start):
    controller, bus = start(Riser())

    def interrupted():
        return {"passive": 0, "stand-up": int(len(bus.sent) > 500), "lie-down": 2, "stop": 2}[
            controller.mode.value
        ]

    report = run_loop(controller, bus, LoopOptions(lock_step=True), interrupted=interrupted)
    assert report.end == "stop (operator)"
    assert bus.sent[-1].mode == JointMode.DAMPING


def test_whatever_goes_wrong_the_last_command_damps(start):
    controller, bus = start(Riser())

    class Full(Log):
        def write(self, tick):
            if tick.mode == "stand-up":
                raise OSError("no space left")

    with pytest.raises(OSError, match="no space left"):
        run_loop(controller, bus, LoopOptions(lock_step=True), log=Full())
    assert bus.sent[-1].mode == JointMode.DAMPING


@pytest.mark.parametrize(
    ("robot", "end"),
    [
        ({"silent": True, "peer_left": True}, "the robot is gone"),
        ({"silent": True}, "no robot answers"),
        ({"forged": {"session": 7}}, "another controller drives the robot"),
        ({"forged": {"status": 2}}, "the robot is not fit to stand up"),
    ],
)
def test_a_robot_that_cannot_be_driven_is_left_alone(start, robot, end):
    controller, bus = start(Riser())
    vars(bus).update(robot)
    waits = {"patience": 0.1, "attended": "not fit" not in end}
    options = LoopOptions(priority=None, lock_step=end != "no robot answers", **waits)
    assert run_loop(controller, bus, options).end == end
    assert {command.mode for command in bus.sent} == {JointMode.OFF}


def test_the_clock_paces_the_loop_and_misses_are_counted(start, monkeypatch):
    controller, bus = start(Sleeper())
    clock, slow = FakeClock(), 0
    monkeypatch.setattr("sprintlab.deployment.controller.loop.time", clock)

    def status(controller, report):
        nonlocal slow
        slow += 1
        clock.sleep(0.0055)

    began = clock.monotonic()
    report = run_loop(controller, bus, LoopOptions(priority=None, duration=0.5), status=status)
    assert report.end == "passive" and slow == 6  # at 0, 0.1, … 0.5 s
    assert report.duration == pytest.approx(0.5, abs=0.006)
    assert clock.monotonic() - began == pytest.approx(report.duration, abs=0.006)
    assert report.deadline_misses == slow and report.skipped == 4 * slow
    assert report.steps + report.skipped == pytest.approx(1000.0 * report.duration, abs=6)
    assert max(report.wake_up) == pytest.approx(0.0005)
    data = report.to_dict()["microseconds"]
    assert data["compute"]["count"] == report.steps and data["policy_step"]["max"] is None
