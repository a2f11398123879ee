"""Estimates against what the robot did: frames, bands, and how they arrive in the metrics."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.short_trials import COARSE

from sprintlab.control import load_policy
from sprintlab.evaluation.estimates import body_velocity, estimate_bands, merge_bands
from sprintlab.evaluation.results import EstimateBand
from sprintlab.evaluation.trial import TrialRequest, run_trial

HEIGHT = 0.5


def turned(angle):
    """Unit quaternion of a yaw."""
    return np.array([[math.cos(angle / 2), 0.0, 0.0, math.sin(angle / 2)]])


@given(
    st.lists(st.floats(-1, 1), min_size=4, max_size=4), st.lists(st.floats(-10, 10), min_size=3, max_size=3)
)
def test_body_velocity_keeps_the_length(quaternion, velocity):
    norm = np.linalg.norm(quaternion)
    unit = np.array([quaternion]) / norm if norm > 1e-3 else turned(0.0)
    result = body_velocity(unit, np.array([velocity]))
    assert np.linalg.norm(result) == pytest.approx(np.linalg.norm(velocity), abs=1e-9)


@pytest.fixture
def run(make_trajectory):
    """Two seconds: one at 1 m/s, one at 5 m/s, with a given estimate."""

    def build(estimate):
        time = np.arange(1000) / 500.0
        speed = np.where(time < 1.0, 1.0, 5.0)
        qvel = np.zeros((1000, 22))
        qvel[:, 0] = speed
        velocity = np.stack((speed, np.zeros(1000)), axis=1)
        qpos = np.zeros((1000, 23))
        qpos[:, 2], qpos[:, 3] = HEIGHT, 1.0
        values = None if estimate is None else estimate(speed)
        return make_trajectory(2.0, time=time, qpos=qpos, qvel=qvel, velocity=velocity, estimate=values)

    return build


def exact(speed):
    """What the trajectory of ``run`` really does."""
    estimate = np.zeros((len(speed), 8))
    estimate[:, 0], estimate[:, 3], estimate[:, 4:] = speed, HEIGHT, 0.9
    return estimate


def test_errors_are_told_apart_by_speed(run):
    def wrong(speed):
        estimate = exact(speed)
        fast = speed > 2.0
        estimate[fast, 0] += 0.3
        estimate[fast, 1] -= 0.4
        estimate[fast, 3] += 0.02
        estimate[fast, 4] = 0.1
        return estimate

    assert estimate_bands(run(None)) == ()
    slow, fast = estimate_bands(run(wrong))
    assert [(band.lower, band.upper, band.samples) for band in (slow, fast)] == [(0, 2, 50), (4, 6, 50)]
    assert slow.velocity_error == slow.height_error == 0.0 and slow.contact_accuracy == 1.0
    assert fast.forward_bias == pytest.approx(0.3) == fast.forward_error
    assert fast.velocity_error == pytest.approx(0.5) and fast.height_error == pytest.approx(0.02)
    assert fast.contact_accuracy == pytest.approx(0.75)


def band(lower, samples, error, contact):
    errors = dict.fromkeys(("forward_bias", "forward_error", "velocity_error", "height_error"), error)
    return EstimateBand(lower=lower, upper=lower + 2, samples=samples, contact_accuracy=contact, **errors)


def test_bands_of_several_trials_merge_by_their_samples():
    merged = merge_bands([band(4.0, 10, 1.0, 1.0), band(0.0, 5, 2.0, 0.5), band(4.0, 30, 3.0, 0.6)])
    assert [item.lower for item in merged] == [0.0, 4.0]
    assert merged[1].samples == 40
    assert merged[1].velocity_error == pytest.approx(math.sqrt((10 * 1.0 + 30 * 9.0) / 40))
    assert merged[1].forward_bias == pytest.approx(2.5)
    assert merged[1].contact_accuracy == pytest.approx(0.7)


def test_a_trial_records_the_estimate_that_the_policy_used(estimating_policy, robot):
    request = TrialRequest(top_speed=0.5, hold=0.5, keep_trajectory=True, plant=COARSE)
    trial = run_trial(load_policy(estimating_policy), robot, request)
    assert trial.trajectory is not None and trial.trajectory.estimate is not None
    height = trial.trajectory.estimate[:, 3]
    np.testing.assert_allclose(height[[0, 9, 10, 20]], [0.25, 0.25, 0.375, 0.4375])  # a step lasts 10 samples
    (band,) = trial.metrics.estimate
    assert (band.lower, band.upper) == (0.0, 2.0) and band.samples == len(height[::10])
    assert band.contact_accuracy > 0.9 and band.velocity_error < 0.1 and band.height_error < 0.05
