"""The example of mjlab: its Go1 by a stand-in for the policy, on mjlab's laws and ours."""

import json
import sys

import numpy as np
import pytest

from sprintlab.motors import drive_torque
from sprintlab.robots import load_robot

pytest.importorskip("mjlab", reason="needs mjlab: pip install 'sprintlab[mjlab]'")
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


@pytest.fixture
def policy(tmp_path):
    write_policy(tmp_path / "go1_policy.onnx")
    return tmp_path / "go1_policy.onnx"


@pytest.fixture
def example(load_script, monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "disabled")
    return load_script("examples/mjlab_go1_walk.py")


@pytest.mark.slow
def test_each_law_delivers_what_it_says(example, policy):
    robot = load_robot("go1")
    drives = example.model_drives(robot)
    for law in example.LAWS:
        for found in example.walks(law, robot, policy, COMMANDS, duration=0.08):
            limit = np.tile([23.7, 23.7, 35.55], 4)
            expected = np.clip(found.asked, -limit, limit)
            if law == "dc_motor":
                top = limit / np.tile([30.1, 30.1, 20.06], 4) * found.speed
                expected = np.clip(
                    found.asked, np.maximum(-limit - top, -limit), np.minimum(limit - top, limit)
                )
            if law == "refined":
                motor, gear, bus_voltage = drives
                expected = drive_torque(motor, gear, found.asked, found.speed, bus_voltage).torque
            np.testing.assert_allclose(found.delivered, expected, atol=2e-3)
            assert np.abs(found.speed[:, 2::3]).max() > 1.0


@pytest.mark.slow
def test_it_runs_from_the_command_line(example, policy, tmp_path, monkeypatch, capsys):
    figure = tmp_path / "walk.png"
    arguments = ["walk", str(policy), "--commands", "1.5", "--duration", "0.04", "--figure", str(figure)]
    monkeypatch.setattr(sys, "argv", [*arguments, "--json"])
    example.main()
    found = json.loads(capsys.readouterr().out)
    assert set(found) == {f"{law}_1.5" for law in example.LAWS}
    assert figure.read_bytes().startswith(b"\x89PNG")


def test_motors_stand_where_mjlabs_joints_stand(example):
    assert example.model_drives(load_robot("go1")).gear.ratio.tolist() == [6.0, 6.0, 9.0] * 4
