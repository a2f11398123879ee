"""The example of mjlab: its Go1 by a stand-in for the policy, on mjlab's laws and ours."""

import importlib.util
import json
import sys

import numpy as np
import pytest

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


@pytest.mark.slow
def test_it_prints_and_draws_what_it_walked(example, tmp_path, monkeypatch, capsys):
    """A short walk of two commands on every law."""
    write_policy(policy := tmp_path / "policy.onnx")
    found = {
        law: example.walks(law, load_robot("go1"), policy, COMMANDS, duration=0.08) for law in example.LAWS
    }
    figure = tmp_path / "walk.png"
    arguments = ["walk", "policy.onnx", "--commands", "0.5", "2", "--figure", str(figure), "--json"]
    monkeypatch.setattr(sys, "argv", arguments)
    monkeypatch.setattr(example, "walks", lambda law, *_: found[law])
    capsys.readouterr()
    example.main()
    printed = json.loads(capsys.readouterr().out)
    assert set(printed) == {f"{law}_{command}" for law in example.LAWS for command in ("0.5", "2")}
    assert printed["refined_2"]["held_m_s"] == round(found["refined"][1].held, 3)
    assert printed["refined_2"]["impossible_work_share"] == 0.0
    assert figure.read_bytes().startswith(b"\x89PNG")
