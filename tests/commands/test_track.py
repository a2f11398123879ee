"""The running track: its geometry against a walk along it, and the loop that keeps to it."""

import math

import numpy as np
import pytest

from sprintlab.commands import Track, path_yaw_rate


def walk(track, offset=0.0, step=0.01):
    """Places, directions and arc lengths of a walk along the path, integrated from its curvature."""
    x, y, direction, length = 0.0, 0.0, 0.0, 0.0
    bend = math.pi * track.radius
    while length < track.length - step:
        normal = (-math.sin(direction), math.cos(direction))
        yield x + offset * normal[0], y + offset * normal[1], direction, length
        half = length % (bend + track.straight)
        turn = step / track.radius if half + step <= bend else max(0.0, bend - half) / track.radius
        middle = direction + turn / 2.0
        x, y = x + step * math.cos(middle), y + step * math.sin(middle)
        direction, length = direction + turn, length + step


def test_lane_one_is_four_hundred_metres():
    assert Track().length == pytest.approx(400.0, abs=0.02)


@pytest.mark.parametrize("offset", [0.0, 0.8, -1.5])
def test_a_walk_along_the_path_is_found_again(offset):
    track = Track()
    for x, y, direction, length in walk(track, offset):
        point = track.locate(x, y)
        assert point.offset == pytest.approx(offset, abs=0.03)
        assert (point.progress - length + 200.0) % 400.0 - 200.0 == pytest.approx(0.0, abs=0.2)
        assert math.cos(point.direction - direction) > 0.9999


@pytest.mark.parametrize("speed", [2.0, 6.0, 10.0])
def test_a_runner_that_obeys_stays_on_the_line(speed):
    track, step = Track(), 0.02
    x, y, heading, farthest = 0.0, 0.3, 0.1, []
    for _ in range(round(track.length / speed / step)):
        point = track.locate(x, y)
        heading += step * path_yaw_rate(point, heading, speed)
        x, y = x + step * speed * math.cos(heading), y + step * speed * math.sin(heading)
        farthest.append(abs(point.offset))
    assert max(farthest) < 1.0 and np.mean(farthest[len(farthest) // 4 :]) < 0.05
    assert heading == pytest.approx(2.0 * math.pi, abs=0.15)


def test_the_command_stays_within_friction():
    track = Track(radius=5.0, straight=0.0)
    rate = path_yaw_rate(track.locate(0.0, 0.0), 0.0, 12.0, friction=0.7)
    assert 12.0 * rate == pytest.approx(0.7 * 9.81, rel=1e-3)
