import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sprintlab.viewer.live import Snapshot
from sprintlab.viewer.page import PaceMeter
from sprintlab.viewer.plots import status_text, value_range

VALUES = st.lists(st.floats(-200.0, 200.0), min_size=1, max_size=20)


@given(values=VALUES)
def test_the_range_of_a_plot_holds_zero_and_every_value(values):
    low, high = value_range(np.array(values))
    assert low <= min(0.0, *values)
    assert high >= max(1.0, *values)


def snapshot(**changes):
    nothing = np.zeros((0, 12))
    state = {"time": 1.0, "speed": 0.0, "command": (0.0, 0.0, 0.0), "bus_power": 0.0, "distance": 0.0}
    rest = {"joint_speed": nothing, "motor_torque": nothing, "falls": 0, "fall_reason": ""}
    return Snapshot(**{**state, **rest, **changes})


def test_standing_robots_have_no_negative_zero_speed():
    assert "-0.0<" not in status_text(snapshot(speed=-0.01), 1.0)
    assert "<b>-0.1</b>" in status_text(snapshot(speed=-0.06), 1.0)


def test_status_tells_why_and_how_often_the_robot_fell():
    text = status_text(snapshot(falls=1, fall_reason="tilt"), 0.25)
    assert "fell: tilt" in text
    assert "1 fall," in text
    assert "0.25 x real time" in text


@given(pace=st.floats(0.01, 2.0))
def test_pace_is_simulated_time_over_the_clock_s(pace):
    meter = PaceMeter()
    shown = [meter.after(pace * 0.033 * step, 0.033 * step) for step in range(100)]
    assert shown[-1] == pytest.approx(pace)


def test_pace_forgets_what_is_older_than_a_second():
    meter = PaceMeter()
    for step in range(100):
        paused = meter.after(min(0.1 * step, 2.0), 0.1 * step)
    assert paused == 0.0
