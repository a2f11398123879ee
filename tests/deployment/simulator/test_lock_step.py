"""A simulated robot that waits for the answer to each of its states."""

from types import SimpleNamespace

import numpy as np
import pytest

from sprintlab.core.errors import SprintlabError
from sprintlab.deployment.interface import PositionFix, RobotState
from sprintlab.deployment.simulator import loop as loop_module
from sprintlab.deployment.simulator.loop import PaceOptions, _LockStep


class Endpoint:
    """Loses what is published until the given time; then answers each state."""

    peer_left, ready = False, True

    def __init__(self, lost):
        self.lost, self.published, self.answers, self.fixes = lost, [], [], []

    def publish(self, state):
        self.published.append(state.sequence)
        if len(self.published) > self.lost:
            self.answers.append(SimpleNamespace(state_sequence=state.sequence))
        return True

    def publish_fix(self, fix):
        self.fixes.append(fix.sequence)

    def receive_command(self):
        return self.answers.pop(0) if self.answers else None


class World:
    time, robot = 0.0, SimpleNamespace(plant=SimpleNamespace(options=SimpleNamespace(motor_rate=1000.0)))

    def __init__(self, *messages):
        self.waiting, self.commands = list(messages), []

    def messages(self, timestamp):
        return self.waiting

    def hand_over(self, command):
        self.commands.append(command)


@pytest.fixture
def state(robot):
    from sprintlab.deployment.simulator import SimulatedRobot, SimulatorOptions

    return SimulatedRobot(robot, SimulatorOptions(start="standing")).state(0)


def test_a_state_that_was_dropped_is_sent_again_and_a_fix_is_not(state: RobotState, monkeypatch):
    """The controller takes a fix that came twice for an old one, which is a fault."""
    monkeypatch.setattr(loop_module, "_ASK_AGAIN", 0.01)
    fix = PositionFix(sequence=4, timestamp=0, position=np.zeros(3), velocity=np.zeros(3))
    world, endpoint = World(fix, state), Endpoint(lost=2)
    assert _LockStep(world, endpoint, PaceOptions(lock_step=True)).exchange(lambda: False)
    assert endpoint.published == [state.sequence] * 3 and endpoint.fixes == [4]
    assert len(world.commands) == 1


def test_who_is_never_answered_gives_up(state: RobotState, monkeypatch):
    monkeypatch.setattr(loop_module, "_ASK_AGAIN", 0.01)
    world, endpoint = World(state), Endpoint(lost=10**6)
    with pytest.raises(SprintlabError, match="has not answered"):
        _LockStep(world, endpoint, PaceOptions(lock_step=True, patience=0.1)).exchange(lambda: False)
    assert len(endpoint.published) > 1 and not world.commands


def test_a_state_that_was_not_sent_yet_is_not_answered(state: RobotState, monkeypatch):
    """Else one such command let the robot run free, for as many steps as its number is ahead."""
    monkeypatch.setattr(loop_module, "_SECOND_THOUGHT", 0.01)
    world, endpoint = World(state), Endpoint(lost=10**6)
    endpoint.answers.append(SimpleNamespace(state_sequence=state.sequence + 5000))
    run = _LockStep(world, endpoint, PaceOptions(lock_step=True, patience=0.1))
    assert run.exchange(lambda: False)  # it answered, but does not accept this state
    with pytest.raises(SprintlabError, match="has not answered"):
        run.exchange(lambda: False)
