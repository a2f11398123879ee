"""A lap of the track: its numbers from made-up runs, and a robot that does not run."""

import math
from dataclasses import replace

import numpy as np
import pytest

from sprintlab.commands import Track
from sprintlab.evaluation.lap import LapCourse, lap_numbers
from sprintlab.plant import BaseState

SMALL = Track(radius=4.0, straight=5.0)


def places(track, length, offsets=0.0):
    """Places ``(T, 2)`` along the path at arc lengths ``(T,)``, to the left of it by ``offsets``."""
    found = []
    for s, offset in np.broadcast(np.asarray(length) % track.length, offsets):
        bend = math.pi * track.radius
        first = s < bend + track.straight
        along = s if first else s - bend - track.straight
        angle = min(along, bend) / track.radius
        x = (track.radius - offset) * math.sin(angle) - max(0.0, along - bend)
        y = track.radius - (track.radius - offset) * math.cos(angle)
        found.append((x, y) if first else (-track.straight - x, 2.0 * track.radius - y))
    return np.array(found)


@pytest.fixture
def make_lap(make_trajectory, make_trial, robot):
    def build(seconds=30.0, outward=0.0):
        """At 2 m/s along the line, after 5 s beside it."""
        time = np.arange(round(seconds * 500)) / 500.0
        qpos = np.zeros((len(time), 23))
        qpos[:, 3] = 1.0
        offset = np.where(time < 5.0, 0.0, -outward)
        qpos[:, :2] = places(SMALL, 2.0 * time, offset)
        trial = replace(make_trial(), trajectory=make_trajectory(seconds, qpos=qpos))
        return lap_numbers(trial, robot, SMALL)

    return build


def test_time_and_lane_of_a_run_along_the_line(make_lap):
    lap = make_lap()
    assert lap["finished"] and lap["time_s"] == pytest.approx(SMALL.length / 2.0, abs=0.01)
    assert lap["lane_kept"] and lap["farthest_outward_m"] < 0.01 and lap["farthest_inward_m"] < 0.01


def test_a_lap_that_is_not_run_to_its_end_has_no_time(make_lap):
    lap = make_lap(seconds=10.0)
    assert not lap["finished"] and lap["time_s"] is None


def test_a_bend_run_too_wide_leaves_the_lane(make_lap):
    lap = make_lap(outward=1.2)
    assert lap["farthest_outward_m"] == pytest.approx(1.2, abs=0.05) and not lap["lane_kept"]


def test_the_command_falls_once_the_lap_is_run():
    course = LapCourse(SMALL, 4.0)
    asked = []
    for index in range(1200):
        time = 0.02 * index
        x, y = places(SMALL, [2.0 * time])[0]
        base = BaseState(forward_speed=2.0, heading=0.0, lateral_offset=y, distance=x)
        if (speed := course.speed(time, base)) is None:
            break
        asked.append(speed)
    assert max(asked) == 4.0 and asked[-1] == 0.0 and 0.02 * len(asked) < SMALL.length / 2.0 + 2.5
    assert course.finish_time == pytest.approx(SMALL.length / 2.0, abs=0.03)
