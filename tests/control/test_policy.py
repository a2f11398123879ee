import numpy as np
import pytest

from sprintlab.control import (
    CONTRACT_KEY,
    Measurement,
    PolicyRuntime,
    load_policy,
    low_pass_coefficient,
    policy,
    shipped_policy,
)
from sprintlab.core.errors import InvalidValueError, PolicyFileError


def draw_measurement(generator):
    return Measurement(*(generator.normal(size=size) for size in (3, 3, 12, 12)))


def test_policy_infers_what_its_matrix_says(write_policy, contract, weights):
    loaded = load_policy(write_policy())
    assert loaded.contract == contract
    observation = np.random.default_rng(1).normal(size=(7, 225)).astype(np.float32)
    action = loaded.decide(observation).action
    assert action.dtype == np.float32
    np.testing.assert_allclose(action, observation @ weights, rtol=1e-4, atol=1e-4)
    with pytest.raises(InvalidValueError, match="225"):
        loaded.decide(observation[:, :45])


def test_another_file_and_an_onnx_file_without_a_contract_are_refused(tmp_path, write_policy):
    path = tmp_path / "poem.onnx"
    path.write_text("I am a poem.")
    with pytest.raises(PolicyFileError, match="damaged or not a sprintlab policy"):
        load_policy(path)
    with pytest.raises(PolicyFileError, match=f"no {CONTRACT_KEY}"):
        load_policy(write_policy(metadata={"author": "somebody"}))


def test_runtime_equals_the_loop_written_out(write_policy, contract, robot, weights):
    generator = np.random.default_rng(2)
    runtime = PolicyRuntime(load_policy(write_policy()), robot)
    coefficient = low_pass_coefficient(10.0, 50.0)
    filtered, frames, previous = None, [], np.zeros(12)
    layout = contract.layout
    scale = np.concatenate([layout.scales(name) for name in layout.layout.terms])
    for _ in range(12):
        measurement, command = draw_measurement(generator), generator.normal(size=3)
        value = np.concatenate(measurement)
        value[6:18] -= robot.default_pose
        filtered = value if filtered is None else filtered + coefficient * (value - filtered)
        frame = np.concatenate([filtered[:6], command, filtered[6:], previous]) * scale
        frames = [frame] * 5 if not frames else [*frames[1:], frame]
        previous = np.clip(np.concatenate(frames) @ weights, -10.0, 10.0)
        targets = runtime.step(measurement, command)
        np.testing.assert_allclose(targets, robot.default_pose + robot.action_scale * previous, atol=1e-4)
        np.testing.assert_allclose(runtime.previous_action, previous, atol=1e-4)


@pytest.mark.parametrize("field", Measurement._fields)
def test_a_measurement_that_is_not_finite_is_refused_and_leaves_no_trace(write_policy, robot, field):
    generator = np.random.default_rng(3)
    runtime, untouched = (PolicyRuntime(load_policy(write_policy()), robot) for _ in range(2))
    first, second, command = draw_measurement(generator), draw_measurement(generator), np.zeros(3)
    runtime.step(first, command)
    untouched.step(first, command)
    broken = np.array(getattr(second, field))
    broken[1] = float("nan")
    with pytest.raises(InvalidValueError) as caught:
        runtime.step(second._replace(**{field: broken}), command)
    assert caught.value.field == f"measurement.{field}"
    np.testing.assert_array_equal(runtime.step(second, command), untouched.step(second, command))


def test_command_and_shapes_are_checked(write_policy, robot):
    runtime = PolicyRuntime(load_policy(write_policy()), robot)
    measurement = draw_measurement(np.random.default_rng(4))
    with pytest.raises(InvalidValueError, match="command"):
        runtime.step(measurement, np.array([1.0, float("nan"), 0.0]))
    with pytest.raises(InvalidValueError, match=r"joint_velocity .* \(12,\)"):
        runtime.step(measurement._replace(joint_velocity=np.zeros(11)), np.zeros(3))


def test_shipped_policy_is_found_by_name_or_the_names_are_told(tmp_path, monkeypatch):
    monkeypatch.setattr(policy, "SHIPPED_POLICIES", tmp_path)
    with pytest.raises(PolicyFileError, match="there is: none"):
        shipped_policy()
    (tmp_path / "sprint.onnx").write_bytes(b"")
    assert shipped_policy("sprint") == tmp_path / "sprint.onnx"
    (tmp_path / "canter.onnx").write_bytes(b"")
    with pytest.raises(PolicyFileError, match="there is: canter, sprint"):
        shipped_policy("gallop")
