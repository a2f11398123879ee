"""The example of mjlab: its Go1 by a stand-in for the policy, on mjlab's laws and ours."""

import importlib.util
import json
import sys

import numpy as np
import pytest

from sprintlab.motors import drive_torque
from sprintlab.robots import load_robot

if importlib.util.find_spec("mjlab") is None:
    pytest.skip("needs mjlab: pip install 'sprintlab[mjlab]'", allow_module_level=True)
pytest.importorskip("onnx", reason="needs onnx")

COMMANDS = np.array([0.5, 2.0])


def write_policy(path):
    """The calves are pushed out, farther for a faster command."""
    from onnx import TensorProto, helper, numpy_helper, save

    weights = np.zeros((48, 12), np.float32)
    weights[45, 2::3] = 1.0
    graph = helper.make_graph(
        [helper.make_node("MatMul", ["obs", "weights"], ["continuous_actions"])],
        "policy",
        [helper.make_tensor_value_info("obs", TensorProto.FLOAT, [1, 48])],
        [helper.make_tensor_value_info("continuous_actions", TensorProto.FLOAT, [1, 12])],
        [numpy_helper.from_array(weights, "weights")],
    )
    save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=10), path)


@pytest.fixture(scope="module")
def example(load_script):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MUJOCO_GL", "disabled")
        return load_script("examples/mjlab_go1_walk.py")


@pytest.fixture(scope="module")
def found(example, tmp_path_factory):
    """A short walk of two commands on every law."""
    policy = tmp_path_factory.mktemp("policy") / "go1_policy.onnx"
    write_policy(policy)
    robot = load_robot("go1")
    return {law: example.walks(law, robot, policy, COMMANDS, duration=0.08) for law in example.LAWS}


@pytest.mark.slow
def test_each_law_delivers_what_it_says(example, found):
    motor, gear, bus_voltage = example.model_drives(load_robot("go1"))
    assert gear.ratio.tolist() == [6.0, 6.0, 9.0] * 4
    limit = np.tile([23.7, 23.7, 35.55], 4)
    for law, walks in found.items():
        for one in walks:
            expected = np.clip(one.asked, -limit, limit)
            if law == "dc_motor":
                top = limit / np.tile([30.1, 30.1, 20.06], 4) * one.speed
                lower, upper = np.maximum(-limit - top, -limit), np.minimum(limit - top, limit)
                expected = np.clip(one.asked, lower, upper)
            if law == "refined":
                expected = drive_torque(motor, gear, one.asked, one.speed, bus_voltage).torque
            np.testing.assert_allclose(one.delivered, expected, atol=2e-3)
            assert np.abs(one.speed[:, 2::3]).max() > 1.0


@pytest.mark.slow
def test_it_prints_and_draws_what_it_walked(example, found, tmp_path, monkeypatch, capsys):
    figure = tmp_path / "walk.png"
    arguments = ["walk", "policy.onnx", "--commands", "0.5", "2", "--figure", str(figure), "--json"]
    monkeypatch.setattr(sys, "argv", arguments)
    monkeypatch.setattr(example, "walks", lambda law, *_: found[law])
    example.main()
    printed = json.loads(capsys.readouterr().out)
    assert set(printed) == {f"{law}_{command}" for law in example.LAWS for command in ("0.5", "2")}
    assert printed["refined_2"]["held_m_s"] == round(found["refined"][1].held, 3)
    assert printed["refined_2"]["impossible_work_share"] == 0.0
    assert figure.read_bytes().startswith(b"\x89PNG")
