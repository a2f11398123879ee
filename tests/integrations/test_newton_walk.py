"""The example of Newton: a stand-in for ANYmal C and its policy, on Newton's laws and ours; needs Newton."""

import json
import sys

import numpy as np
import pytest

from sprintlab.motors import drive_torque

newton = pytest.importorskip("newton", reason="needs Newton 1.8")
pytest.importorskip("mujoco", minversion="3.17", reason="needs newton[sim]")
pytest.importorskip("onnx", reason="needs onnx")
if not hasattr(newton, "ModelBuilder"):
    pytest.skip("needs Newton 1.8", allow_module_level=True)

LEGS = {"LF": (0.3, 0.1), "LH": (-0.3, 0.1), "RF": (0.3, -0.1), "RH": (-0.3, -0.1)}


def link(name, mass, geometry, place="0 0 0"):
    inertia = "ixx='.02' iyy='.02' izz='.02' ixy='0' ixz='0' iyz='0'"
    return (
        f"<link name='{name}'><inertial><mass value='{mass}'/><inertia {inertia}/></inertial>"
        "<visual><geometry><mesh filename='missing.dae'/></geometry></visual>"
        f"<collision><origin xyz='{place}'/><geometry>{geometry}</geometry></collision></link>"
    )


def joint(name, parent, child, place, axis):
    return (
        f"<joint name='{name}' type='revolute'><parent link='{parent}'/><child link='{child}'/>"
        f"<origin xyz='{place}'/><axis xyz='{axis}'/>"
        "<limit effort='80' lower='-9' upper='9' velocity='7.5'/></joint>"
    )


def stand_in():
    parts = [link("base", 25.0, "<box size='.6 .2 .2'/>")]
    for leg, (x, y) in LEGS.items():
        parts += [
            link(f"{leg}_HIP", 2.0, "<sphere radius='.01'/>"),
            link(f"{leg}_THIGH", 2.0, "<sphere radius='.01'/>"),
            link(f"{leg}_SHANK", 0.5, "<sphere radius='.03'/>", "0 0 -.3"),
            joint(f"{leg}_HAA", "base", f"{leg}_HIP", f"{x} {y} 0", "1 0 0"),
            joint(f"{leg}_HFE", f"{leg}_HIP", f"{leg}_THIGH", f"0 {y} 0", "0 1 0"),
            joint(f"{leg}_KFE", f"{leg}_THIGH", f"{leg}_SHANK", "0 0 -.3", "0 1 0"),
        ]
    return f"<robot name='anymal'>{''.join(parts)}</robot>"


def write_policy(path):
    """Knees that are pushed, and pushed on by their speed."""
    from onnx import TensorProto, helper, numpy_helper, save

    weights, push = np.zeros((48, 12), np.float32), np.zeros(12, np.float32)
    push[8:] = [-2.0, 2.0, -2.0, 2.0]
    weights[32:36, 8:] = 0.5 * np.eye(4)
    graph = helper.make_graph(
        [helper.make_node("Gemm", ["seen", "weights", "push"], ["action"])],
        "policy",
        [helper.make_tensor_value_info("seen", TensorProto.FLOAT, [1, 48])],
        [helper.make_tensor_value_info("action", TensorProto.FLOAT, [1, 12])],
        [numpy_helper.from_array(weights, "weights"), numpy_helper.from_array(push, "push")],
    )
    save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=10), path)


@pytest.fixture
def assets(tmp_path):
    for folder in ("urdf", "rl_policies"):
        (tmp_path / folder).mkdir()
    (tmp_path / "urdf" / "anymal.urdf").write_text(stand_in())
    write_policy(tmp_path / "rl_policies" / "anymal_walking_policy_physx.onnx")
    return tmp_path


@pytest.fixture
def example(load_script):
    return load_script("examples/newton_anymal_walk.py")


def test_each_law_delivers_what_it_says(example, assets):
    urdf, motor = example.bare_urdf(assets / example.URDF), example.drive_motor()
    drives = example.all_drives(motor)
    walks = {
        name: example.walk(urdf, assets / example.POLICY, law, duration=0.3)
        for name, law in example.clampings(motor).items()
    }
    own, line, refined = walks.values()
    np.testing.assert_allclose(own.delivered, np.clip(own.asked, -80.0, 80.0), atol=1e-2)
    upper = np.clip(120.0 * (1.0 - line.speed / 7.5), -80.0, 80.0)
    lower = np.clip(-120.0 * (1.0 + line.speed / 7.5), -80.0, 80.0)
    inside = np.abs(line.speed) < 7.5
    np.testing.assert_allclose(line.delivered[inside], np.clip(line.asked, lower, upper)[inside], atol=1e-2)
    law = drive_torque(drives.motor, drives.gear, refined.asked, refined.speed, drives.bus_voltage).torque
    np.testing.assert_allclose(refined.delivered, law, atol=2e-2)
    assert np.abs(own.speed).max() > np.abs(refined.speed).max() + 0.3
    shares = [example.impossible_share(one, drives) for one in walks.values()]
    assert shares[0] > shares[1] > shares[2] and shares[2] < 1e-3


def test_the_motor_has_isaac_labs_line_without_its_inductance(example):
    motor = example.drive_motor()
    speed = np.linspace(0.0, 7.5, 16)
    torque = drive_torque(motor, example.GEAR, 1e3, speed, example.BUS_VOLTAGE, model="simplified-dc").torque
    np.testing.assert_allclose(torque, np.minimum(80.0, 120.0 * (1.0 - speed / 7.5)), atol=1e-9)


def test_it_runs_from_the_command_line(example, assets, monkeypatch, capsys):
    figure = assets / "walk.png"
    arguments = ["walk", "--assets", str(assets), "--duration", "0.3", "--figure", str(figure), "--json"]
    monkeypatch.setattr(sys, "argv", arguments)
    example.main()
    found = json.loads(capsys.readouterr().out)
    assert found["fastest_joint_refined_rad_s"] < found["fastest_joint_peak_torque_rad_s"]
    assert figure.read_bytes().startswith(b"\x89PNG")
