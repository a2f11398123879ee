import math

import numpy as np
import pytest

from sprintlab.control import LowPass, joint_targets, low_pass, low_pass_coefficient


@pytest.mark.parametrize(("cutoff", "rate"), [(10.0, 50.0), (3.0, 50.0), (10.0, 1000.0)])
def test_filter_equals_scipy(cutoff, rate):
    """The step-invariant discretization of w / (s + w), run by ``scipy.signal.lfilter``."""
    signal = pytest.importorskip("scipy.signal")
    values = np.random.default_rng(0).normal(size=300)
    omega = 2 * math.pi * cutoff
    numerator, denominator, _ = signal.cont2discrete(([omega], [1.0, omega]), 1 / rate, method="zoh")
    coefficient = low_pass_coefficient(cutoff, rate)
    np.testing.assert_allclose(denominator, [1.0, coefficient - 1.0], atol=1e-12)
    np.testing.assert_allclose(numerator.ravel(), [0.0, coefficient], atol=1e-12)
    # lfilter's numerator without the pure delay: our output already holds the newest sample
    expected = signal.lfilter([coefficient], denominator, values)
    state, outputs = np.zeros(()), []
    for value in values:
        state = low_pass(state, value, coefficient)
        outputs.append(float(state))
    np.testing.assert_allclose(outputs, expected, atol=1e-12)


def test_fresh_rows_start_from_their_value_in_both_libraries(torch):
    generator = np.random.default_rng(1)
    previous, value = generator.normal(size=(6, 30)), generator.normal(size=(6, 30))
    reset_mask = np.array([True, False, True, False, False, False])
    filtered = LowPass().step(previous, value, reset_mask)
    np.testing.assert_array_equal(filtered[reset_mask], value[reset_mask])
    np.testing.assert_allclose(
        filtered[~reset_mask], low_pass(previous, value, LowPass().coefficient)[~reset_mask]
    )
    tensors = (torch.from_numpy(array) for array in (previous, value, reset_mask))
    np.testing.assert_allclose(LowPass().step(*tensors).numpy(), filtered, atol=1e-15)


def test_joint_targets_are_limited_scaled_and_offset(torch):
    pose, scale = np.linspace(-1, 1, 12), np.linspace(0.2, 0.5, 12)
    action = np.random.default_rng(2).normal(scale=5, size=(100, 12))
    expected = pose + scale * np.clip(action, -4.0, 4.0)
    np.testing.assert_allclose(joint_targets(action, pose, scale, 4.0), expected, atol=1e-12)
    tensors = (torch.from_numpy(array) for array in (action, pose, scale))
    np.testing.assert_allclose(joint_targets(*tensors, 4.0).numpy(), expected, atol=1e-12)
    np.testing.assert_array_equal(joint_targets(np.zeros(12), pose, scale, 4.0), pose)
