"""Whole trials with policies small enough to know their answer."""

import math

import numpy as np
import pytest

from sprintlab.control import load_policy
from sprintlab.evaluation import trial as trial_module
from sprintlab.evaluation.report_text import sprint_text
from sprintlab.evaluation.trial import TrialRequest, run_sprint, run_trial
from sprintlab.plant import Plant, PlantOptions, TrialSettings

SHORT = {"top_speed": 0.5, "hold": 1.0, "keep_trajectory": True}


@pytest.fixture(scope="module")
def stander(standing_policy):
    return load_policy(standing_policy)


def test_a_standing_policy_completes_without_moving(stander, robot):
    result = run_trial(stander, robot, TrialRequest(**SHORT, settings=TrialSettings(joint_noise=0.05)))
    assert result.completed and result.fall_time is None
    assert abs(result.metrics.held_speed) < 0.01
    assert result.audit.passed
    assert result.hold_interval == (1.125, 2.125)
    assert result.trajectory.time[-1] == pytest.approx(4.25, abs=0.02)
    assert np.diff(result.trajectory.time) == pytest.approx(0.002)


@pytest.mark.usefixtures("short_trials")
def test_the_same_seed_gives_the_same_run_and_another_seed_another(stander, robot):
    def last(seed):
        settings = TrialSettings(seed=seed, joint_noise=0.05)
        return run_trial(stander, robot, TrialRequest(**SHORT, settings=settings)).trajectory.qpos[-1]

    first = last(1)
    np.testing.assert_array_equal(first, last(1))
    assert (first != last(2)).any()


def test_legs_pulled_up_are_a_fall_with_time_and_reason(make_policy, robot):
    policy = load_policy(make_policy(np.tile([0.0, 3.0, -5.0], 4)))
    result = run_trial(policy, robot, TrialRequest(**SHORT))
    assert not result.completed
    assert result.fall_reason in ("trunk contact", "knee contact", "tilt")
    assert 0.0 < result.fall_time < 2.0
    assert result.trajectory.time[-1] == pytest.approx(result.fall_time, abs=0.005)
    assert math.isnan(result.metrics.held_speed)


def test_a_sprint_counts_from_the_first_command_to_the_distance(stander, robot, monkeypatch):
    """A base that is carried at 2 m/s covers one metre in half a second and then brakes."""
    from sprintlab.evaluation import trial as module

    class CarriedPlant(Plant):
        def advance(self, targets, motor_steps, recorder):
            self.data.qpos[0] = 2.0 * max(0.0, self.time - 1.0)
            return super().advance(targets, motor_steps, recorder)

    monkeypatch.setattr(module, "open_plant", CarriedPlant)
    sprint = run_sprint(stander, robot, TrialRequest(top_speed=2.0, distance=1.0, keep_trajectory=True))
    assert sprint.time == pytest.approx(0.5, abs=0.05)
    trajectory = sprint.trial.trajectory
    assert trajectory.profile_speed.max() == 2.0 and trajectory.profile_speed[-1] == 0.0
    assert trajectory.time[-1] > 1.0 + sprint.time + 0.5 + 1.9


def test_a_gear_passes_on_what_is_left_after_turning_the_rotor(make_policy, robot):
    """In the air a hip that is asked for a far target turns its rotor and its leg."""
    from sprintlab.evaluation.recorder import Recorder

    plant = Plant(robot, PlantOptions(record_rate=1000.0), TrialSettings())
    plant.data.qpos[2] += 1.0
    recorder = Recorder(plant, capacity=10)
    targets = np.asarray(robot.default_pose, dtype=float)
    plant.advance(targets + 0.05, 5, recorder)
    run = recorder.trajectory()
    turned = np.diff(run.joint_velocity, axis=0, prepend=0.0)[1:] * 1000.0
    left = run.joint_torque[:-1] - robot.armature * turned
    np.testing.assert_allclose(run.gear_torque[1:], left, atol=1e-6)
    assert (np.abs(turned * robot.armature).max(axis=0) > 0.5).all()


@pytest.mark.usefixtures("short_trials")
def test_who_does_not_stop_has_not_completed(robot, stander, monkeypatch):
    """The same trial, once with a limit that nothing keeps: what would run on has not completed."""
    request = TrialRequest(top_speed=0.5, hold=0.5)
    assert run_trial(stander, robot, request).completed
    monkeypatch.setattr(trial_module, "REST_SPEED", 0.0)
    moving = run_trial(stander, robot, request)
    assert not moving.completed
    assert moving.fall_reason == ""


def test_a_sprint_of_a_robot_that_gets_nowhere_is_given_up_after_ten_seconds_of_standing(stander, robot):
    plant = PlantOptions(timestep=0.0005, contact_time_constant=0.001)
    request = TrialRequest(top_speed=10.0, distance=500.0, plant=plant, keep_trajectory=True)
    sprint = run_sprint(stander, robot, request)
    assert sprint.stalled and not sprint.finished
    assert sprint.trial.trajectory.time[-1] < 11.1
    assert sprint_text(sprint).startswith("given up: less than 1 m in 10 s")
