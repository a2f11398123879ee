"""What comes between policy and robot: ticks of the clock, noise, offsets, delay, pushes."""

import dataclasses
import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.short_trials import COARSE

from sprintlab.control import Measurement, PolicyRuntime, load_policy
from sprintlab.evaluation.disturbances import SENSOR_NOISE, Disturbances, PolicyClock
from sprintlab.evaluation.trial import TrialRequest, run_trial
from sprintlab.plant import Plant, PlantOptions, TrialSettings

READING = Measurement(np.zeros(3), np.zeros(3), np.zeros(12), np.zeros(12))


def ticks(clock, count=5000, seed=0):
    return np.array(list(itertools.islice(clock.periods(1000.0, seed), count)))


@given(st.floats(20.0, 200.0))
def test_the_mean_rate_is_kept_though_ticks_fall_on_motor_steps(rate):
    periods = ticks(PolicyClock(rate=rate), 2000)
    assert periods.sum() == pytest.approx(2000 * 1000.0 / rate, abs=1.0)
    assert np.ptp(periods) <= 1


def test_jitter_draws_periods_of_the_stated_width_anew_for_every_seed():
    clock = PolicyClock(jitter=0.1)
    periods = ticks(clock)
    assert periods.min() == 18 and periods.max() == 22
    assert periods.mean() == pytest.approx(20.0, abs=0.1)
    assert (ticks(clock) == periods).all() and (ticks(clock, seed=1) != periods).any()


@pytest.mark.usefixtures("brief_trials")
def test_the_policy_is_asked_when_the_clock_says_so(standing_policy, robot, monkeypatch):
    asked, step = [], PolicyRuntime.step
    monkeypatch.setattr(
        PolicyRuntime, "step", lambda self, *inputs: (asked.append(1), step(self, *inputs))[1]
    )
    request = TrialRequest(top_speed=0.5, hold=0.5, plant=COARSE, keep_trajectory=True)
    request = dataclasses.replace(request, clock=PolicyClock(rate=25.0))
    end = run_trial(load_policy(standing_policy), robot, request).trajectory.time[-1]
    assert len(asked) == pytest.approx(end * 25.0, abs=1.5)


def test_noise_fills_its_band_and_follows_the_seed(robot):
    def readings(seed):
        noisy = Disturbances(robot, TrialSettings(seed=seed, sensor_noise=2.0), 1000.0)
        return [noisy.measured(READING) for _ in range(500)]

    one, again, other = readings(1), readings(1), readings(2)
    for name, width in SENSOR_NOISE._asdict().items():
        values = np.array([getattr(reading, name) for reading in one])
        assert np.abs(values).max() <= 2.0 * width and np.abs(values).max() > 1.9 * width
    np.testing.assert_array_equal(one[7].joint_velocity, again[7].joint_velocity)
    assert (one[7].joint_velocity != other[7].joint_velocity).any()


def test_an_encoder_offset_shifts_reading_and_target_against_each_other(robot):
    offset = Disturbances(robot, TrialSettings(seed=5, joint_offset=0.02), 1000.0)
    read = offset.measured(READING).joint_position
    ((held, _),) = offset.delivered(np.zeros(12), 20)
    assert 0.005 < np.abs(read).max() <= 0.02
    np.testing.assert_allclose(held, -read)


def test_targets_arrive_late(robot):
    late = Disturbances(robot, TrialSettings(delay=0.0072), 1000.0)
    first, second = np.zeros(12), np.ones(12)
    assert [steps for _, steps in late.delivered(first, 20)] == [20]
    assert [(held[0], steps) for held, steps in late.delivered(second, 20)] == [(0.0, 7), (1.0, 13)]


def test_pushes_have_their_size_their_rate_and_every_direction(robot):
    class Trunk:
        time, changes = 2.0, []

        def push(self, change):
            self.changes.append(change)

    pushed = Disturbances(robot, TrialSettings(push_speed=0.5), 1000.0)
    for _ in range(20_000):
        pushed.push(Trunk(), 20)
    changes = np.array(Trunk.changes)
    np.testing.assert_allclose(np.linalg.norm(changes, axis=1), 0.5)
    assert len(changes) == pytest.approx(133, rel=0.25)
    assert (changes.max(axis=0) > 0.4).all() and (changes.min(axis=0) < -0.4).all()


def test_the_plant_is_as_weak_and_lopsided_as_the_trial_says(robot):
    settings = TrialSettings(center_of_mass=(0.02, -0.01, 0.03), strength=0.9)
    nominal, changed = (Plant(robot, PlantOptions(), chosen) for chosen in (TrialSettings(), settings))
    trunk = nominal.model.body("trunk").id
    moved = changed.model.body_ipos[trunk] - nominal.model.body_ipos[trunk]
    np.testing.assert_allclose(moved, (0.02, -0.01, 0.03))

    given = [plant.drive_joints(np.full(12, 5.0), np.zeros(12)) for plant in (nominal, changed)]
    np.testing.assert_allclose(given[1].torque, 0.9 * given[0].torque)
    before = changed.data.qvel[:2].copy()
    changed.push(np.array([0.3, -0.4]))
    np.testing.assert_allclose(changed.data.qvel[:2] - before, (0.3, -0.4))
