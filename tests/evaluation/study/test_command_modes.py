"""The same targets asked for in different ways."""

import numpy as np
import pytest
from studies.paper.command_modes import COMMAND_MODES, CommandSequence

from sprintlab.core.errors import InvalidValueError
from sprintlab.plant import BaseState


def commands(course, speed=lambda time, command: 0.0):
    """Every command of a course for a robot of which ``speed`` tells how fast it is."""
    given, time, command = [], 0.0, 0.0
    while True:
        base = BaseState(forward_speed=speed(time, command), heading=0.0, lateral_offset=0.0, distance=0.0)
        asked = course.speed(time, base)
        if asked is None:
            return np.array(given)
        given.append(asked)
        command, time = asked, time + 0.02


@pytest.mark.parametrize("mode", COMMAND_MODES)
def test_every_mode_stands_first_and_lasts_as_long(mode):
    given = commands(CommandSequence(mode=mode, top_speed=8.0, count=3))
    assert len(given) == round((1.0 + 3 * 4.0) / 0.02)
    assert not given[:49].any() and given[-1] > 0.0 and given.max() <= 8.0


def test_targets_are_the_same_in_every_mode_but_the_step():
    targets = {mode: CommandSequence(mode=mode, top_speed=8.0).targets for mode in COMMAND_MODES}
    assert targets["uniform"] == targets["adaptive"] == targets["fixed-acceleration"]
    assert np.ptp(targets["uniform"]) > 2.0 and set(targets["step"]) == {8.0}
    assert targets["uniform"] != CommandSequence(mode="uniform", top_speed=8.0, seed=2).targets


def test_uniform_jumps_and_the_fixed_rate_does_not():
    jumps = np.abs(np.diff(commands(CommandSequence(mode="uniform", top_speed=8.0))))
    slow = np.abs(np.diff(commands(CommandSequence(mode="fixed-acceleration", top_speed=8.0))))
    assert jumps.max() > 1.0 and slow.max() == pytest.approx(3.0 * 0.02)


def test_adaptive_waits_for_the_robot():
    stuck = commands(CommandSequence(mode="adaptive", top_speed=8.0))
    assert stuck.max() == pytest.approx(1.0)
    follows = commands(
        CommandSequence(mode="adaptive", top_speed=8.0), speed=lambda time, command: 0.9 * command
    )
    assert follows.max() > 7.0


@pytest.mark.parametrize("values", [{"mode": "jump"}, {"top_speed": 0.0}, {"count": 0}, {"period": -1.0}])
def test_impossible_courses_are_refused(values):
    with pytest.raises(InvalidValueError):
        CommandSequence(**{"mode": "uniform", "top_speed": 8.0, **values})
