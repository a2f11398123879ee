import numpy as np
import pytest

from sprintlab.control import (
    Measurement,
    ObservationLayout,
    fill_history,
    observation_frame,
    projected_gravity,
    push_history,
    update_history,
)

SIZES = {
    "angular_velocity": 3,
    "projected_gravity": 3,
    "command": 3,
    "joint_position": 12,
    "joint_velocity": 12,
    "previous_action": 12,
}


def draw_terms(n=6):
    generator = np.random.default_rng(0)
    return {name: generator.normal(size=(n, size)) for name, size in SIZES.items()}


def test_frame_holds_the_scaled_terms_in_the_order_of_the_layout():
    layout, terms = ObservationLayout(), draw_terms()
    measured = Measurement(*(terms[name] for name in Measurement._fields))
    frame = observation_frame(layout, measured, terms["command"], terms["previous_action"])
    start, observation = 0, layout.for_joints(12)
    assert (frame.shape, observation.frame_size, observation.input_size) == ((6, 45), 45, 225)
    for name in layout.terms:
        size = SIZES[name]
        expected = terms[name] * np.array(observation.scales(name))
        assert observation.place(name) == slice(start, start + size)
        np.testing.assert_allclose(frame[:, start : start + size], expected, rtol=1e-12)
        start += size
    assert start == 45


def test_fresh_rows_start_their_history_anew(torch):
    generator = np.random.default_rng(1)
    history, frame = generator.normal(size=(8, 5, 45)), generator.normal(size=(8, 45))
    reset_mask = np.arange(8) % 3 == 0
    updated = update_history(history, frame, reset_mask)
    for row in range(8):
        expected = fill_history(frame[row], 5) if reset_mask[row] else push_history(history[row], frame[row])
        np.testing.assert_array_equal(updated[row], expected)
    tensors = (torch.from_numpy(value) for value in (history, frame, reset_mask))
    np.testing.assert_array_equal(update_history(*tensors).numpy(), updated)


def test_on_a_slope_the_gravity_direction_is_that_of_the_true_vertical(torch):
    random = np.random.default_rng(1)
    quaternion = random.normal(size=(5, 4))
    quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
    slope = random.uniform(-0.3, 0.3, 5)
    rotation = pytest.importorskip("scipy.spatial.transform").Rotation.from_quat(
        quaternion, scalar_first=True
    )
    down = np.stack([-np.sin(slope), np.zeros(5), -np.cos(slope)], axis=-1)
    turned = rotation.inv().apply(down)
    np.testing.assert_allclose(projected_gravity(quaternion, slope), turned, atol=1e-12)
    on_torch = projected_gravity(torch.from_numpy(quaternion), torch.from_numpy(slope))
    np.testing.assert_allclose(on_torch.numpy(), turned, atol=1e-12)
