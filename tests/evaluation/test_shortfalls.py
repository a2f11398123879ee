"""The benchmark that tells why ``sprint`` falls short changes what it says it changes, and nothing else."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from sprintlab.control import load_policy, shipped_policy
from sprintlab.motors import saturate
from sprintlab.robots import load_robot


@pytest.fixture(scope="module")
def shortfalls(load_script):
    return load_script("benchmarks/shortfalls.py")


@pytest.fixture(scope="module")
def policy():
    return load_policy(shipped_policy("sprint"))


@pytest.fixture
def observation(policy):
    return np.random.default_rng(0).normal(0.0, 0.3, (1, policy.layout.input_size)).astype(np.float32)


def test_a_higher_peak_torque_leaves_what_saturation_takes_below_the_old_one(shortfalls):
    robot = load_robot("bp2")
    stronger = shortfalls.with_peak_torque(robot, 1.5).motors
    torque = 0.9 * robot.motors.peak_torque
    np.testing.assert_allclose(saturate(stronger, torque), saturate(robot.motors, torque), rtol=1e-12)
    np.testing.assert_allclose(stronger.peak_torque, 1.5 * robot.motors.peak_torque)
    changed = {"peak_torque": robot.motors.peak_torque, "saturation": robot.motors.saturation}
    np.testing.assert_equal(vars(replace(stronger, **changed)), vars(robot.motors))


def test_a_policy_that_is_told_its_speed_acts_on_it_and_on_nothing_else(shortfalls, policy, observation):
    ramp = shortfalls.Ramp(10.0, SimpleNamespace(forward_speed=9.0))
    told, watched = (shortfalls.Watched(policy, ramp, error) for error in (-1.0, None))
    own, first = watched.decide(observation), told.decide(observation)
    true = told.newest * 9.0
    assert first.estimate[0, 0] == pytest.approx(true - 1.0, abs=1e-5)
    np.testing.assert_allclose(first.estimate[0, 1:], own.estimate[0, 1:], atol=1e-6)
    assert np.abs(first.action - own.action).max() > 1e-3, "the policy uses its estimate"
    second = told.decide(observation, first.estimate)
    assert second.estimate[0, 0] == pytest.approx(true + told.newest * (9.0 - true) - 1.0, abs=1e-5)
    np.testing.assert_array_equal(own.estimate, policy.decide(observation).estimate)


def test_the_estimate_does_not_read_the_command(shortfalls, policy, observation):
    without = shortfalls.without_command(policy, observation)
    changed = (without != observation).reshape(policy.layout.history_length, -1)
    command = policy.layout.place("command")
    assert changed[:, command].all() and changed.sum() == 3 * policy.layout.history_length
    twice = np.concatenate((observation, without))
    speeds = shortfalls.unfiltered(policy, twice)
    assert speeds[0] == speeds[1] and speeds[0] != 0.0


def test_the_rest_of_a_mean_makes_it_together_with_its_part(shortfalls, policy, observation, tmp_path):
    onnx = pytest.importorskip("onnx")
    whole, part = shipped_policy("sprint"), Path(__file__).parents[2] / shortfalls.FAST
    rest = shortfalls.rest_of_mean(whole, part, 0.2, tmp_path / "rest.onnx")
    assert load_policy(rest).contract == policy.contract
    weights = [
        {each.name: onnx.numpy_helper.to_array(each) for each in onnx.load(path).graph.initializer}
        for path in (whole, part, rest)
    ]
    for name, value in weights[0].items():
        np.testing.assert_allclose(0.2 * weights[1][name] + 0.8 * weights[2][name], value, atol=1e-6)
