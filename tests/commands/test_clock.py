"""The stopwatch of a run: zero while the robot still stands, halted at the finish."""

import numpy as np
import pytest

from sprintlab.commands import SprintProfile, command_start, finish_time, race_clock

TIME = np.arange(0.0, 12.0, 0.002)


def test_the_clock_leaves_out_the_second_of_standing():
    speed = SprintProfile(top_speed=12.0).command(TIME)
    assert command_start(TIME, speed) == pytest.approx(1.0, abs=0.0021)
    clock = race_clock(TIME, speed, finish=11.24)
    assert not clock[TIME <= 1.0].any() and np.all(np.diff(clock) >= 0.0)
    assert clock[-1] == pytest.approx(10.24, abs=0.0021)


def test_the_finish_lies_between_two_samples_or_nowhere():
    time, way = np.array([0.0, 1.0, 2.0]), np.array([0.0, 4.0, 8.0])
    assert finish_time(time, way, 5.0) == 1.25
    assert np.isnan(finish_time(time, way, 9.0)) and np.isnan(finish_time(time, way, 0.0))
