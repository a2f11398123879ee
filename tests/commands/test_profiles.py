import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sprintlab.commands import (
    AdaptiveSchedule,
    CommandStep,
    SpeedProfile,
    SprintProfile,
    TargetSampling,
    heading_angle,
    heading_command,
    initial_state,
    self_paced,
    wrap_angle,
)


def test_profile_of_twelve_metres_a_second():
    profile = SpeedProfile(top_speed=12.0)
    assert profile.duration == 19.0
    assert profile.hold_interval == (4.0, 14.0)
    times = np.array([-1.0, 0.0, 1.0, 2.5, 4.0, 6.0, 14.0, 15.0, 17.0, 19.0, 99.0])
    expected = [0.0, 0.0, 0.0, 6.0, 12.0, 12.0, 12.0, 8.0, 0.0, 0.0, 0.0]
    np.testing.assert_allclose(profile.command(times), expected, atol=1e-12)
    assert float(profile.command(2.5)) == 6.0


@given(top=st.floats(0.25, 20), acceleration=st.floats(0.5, 10), hold=st.floats(0, 10), stand=st.floats(0, 3))
def test_profile_respects_its_bounds_and_covers_its_distance(top, acceleration, hold, stand):
    profile = SpeedProfile(top_speed=top, acceleration=acceleration, hold=hold, stand=stand)
    times = np.linspace(0.0, profile.duration, 4001)
    speed = profile.command(times)
    assert speed.min() >= 0.0 and speed.max() <= top
    steepest = np.max(np.abs(np.diff(speed))) / (times[1] - times[0])
    assert steepest <= acceleration * (1 + 1e-6)
    distance = np.sum((speed[1:] + speed[:-1]) / 2) * (times[1] - times[0])
    assert distance == pytest.approx(top * hold + top**2 / acceleration, rel=2e-2, abs=1e-3)


def test_sprint_holds_until_the_distance_is_reported():
    sprint = SprintProfile(top_speed=12.0)
    times = np.array([0.0, 1.0, 2.0, 4.0, 50.0])
    np.testing.assert_allclose(sprint.command(times), [0.0, 0.0, 4.0, 12.0, 12.0])
    np.testing.assert_allclose(
        sprint.command(np.array([9.9, 10.0, 11.0, 13.0, 20.0]), 10.0), [12, 12, 8, 0, 0]
    )
    assert sprint.end_time(10.0) == 13.0


@given(
    command=st.floats(-15, 15),
    speed=st.floats(-15, 15),
    window=st.floats(0.1, 3),
    braking_window=st.floats(0.1, 5),
)
def test_self_paced_command_neither_leads_nor_lags(command, speed, window, braking_window, torch):
    paced = float(self_paced(command, speed, window, braking_window))
    lead = paced - speed
    assert -braking_window * (1 + 1e-9) <= lead <= window * (1 + 1e-9)
    if -braking_window * (1 - 1e-9) <= command - speed <= window * (1 - 1e-9):
        assert paced == command
    tensors = (torch.tensor(value, dtype=torch.float64) for value in (command, speed))
    assert float(self_paced(*tensors, window, braking_window)) == paced


@given(target=st.floats(-2, 14), speed=st.floats(-2, 14))
def test_self_paced_command_is_that_of_the_schedule_in_training(target, speed):
    """Its farthest reach, that is: in training an update reaches down by a drawn part of it."""
    schedule = AdaptiveSchedule(biased_share=1.0, targets=TargetSampling(persistence=(9.0, 9.0)))
    state = initial_state(1, np.zeros(1))._replace(
        target_speed=np.array([target]), time_to_target=np.array([9.0])
    )
    random = np.array([[0.5, 0.5, 0.5, 0.5, 0.5, 1.0, 0.0, 0.5]])
    step = CommandStep(
        np.array([speed]), 0.02, -2.0, 14.0, friction=0.8, reset_mask=np.zeros(1, dtype=bool), random=random
    )
    commanded = schedule.advance(state, step).command[0, 0]
    assert commanded == pytest.approx(np.clip(float(self_paced(target, speed)), -2.0, 14.0))


@given(angle=st.floats(-50, 50))
def test_wrapped_angle_is_the_same_direction(angle):
    wrapped = float(wrap_angle(np.asarray(angle)))
    assert abs(wrapped) <= math.pi
    assert math.cos(wrapped - angle) == pytest.approx(1.0)


def test_heading_of_a_turn_about_the_vertical(torch):
    angles = np.linspace(-3.1, 3.1, 9)
    zero = np.zeros_like(angles)
    quaternions = np.stack([np.cos(angles / 2), zero, zero, np.sin(angles / 2)], axis=-1)
    np.testing.assert_allclose(heading_angle(quaternions), angles, atol=1e-12)
    np.testing.assert_allclose(heading_angle(torch.from_numpy(quaternions)).numpy(), angles, atol=1e-12)


@pytest.mark.parametrize("speed", [1.0, 4.0, 12.0, -2.0])
def test_heading_loop_removes_an_offset_in_two_seconds(speed):
    """Poles at -2 +- 2i 1/s: the offset falls as (cos 2t + sin 2t) exp(-2t) while nothing saturates."""

    def derivative(_, state):
        offset, heading = state
        return [speed * heading, float(heading_command(heading, offset, speed))]

    times = np.linspace(0.0, 8.0, 81)
    run = pytest.importorskip("scipy.integrate").solve_ivp(
        derivative, (0.0, 8.0), [0.05, 0.0], t_eval=times, rtol=1e-9, atol=1e-11
    )
    expected = 0.05 * (np.cos(2 * times) + np.sin(2 * times)) * np.exp(-2 * times)
    np.testing.assert_allclose(run.y[0], expected, atol=1e-6)


@given(heading=st.floats(-7, 7), offset=st.floats(-20, 20), speed=st.floats(-15, 15))
def test_heading_command_obeys_its_limits(heading, offset, speed):
    rate = float(heading_command(heading, offset, speed, friction=0.7))
    assert abs(rate) <= 1.0
    assert abs(rate * speed) <= 0.7 * 9.81 * (1 + 1e-9)
