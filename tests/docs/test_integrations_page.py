"""The snippets of docs/integrations.md, each run where what it needs is installed."""

import importlib.util
import re
from pathlib import Path

import mujoco
import pytest

from sprintlab.motors import no_load_speed

PAGE = Path(__file__).resolve().parents[2] / "docs" / "integrations.md"


def snippet(heading):
    found = re.search(
        rf"^## {heading}\n.*?```python\n(.*?)```", PAGE.read_text("utf-8"), re.MULTILINE | re.DOTALL
    )
    assert found is not None
    return found[1]


def run(heading):
    names = {"__name__": "example"}
    exec(compile(snippet(heading), f"{PAGE.name}: {heading}", "exec"), names)
    return names


def test_plain_mujoco_reaches_its_target_within_the_motors_speed():
    names = run("Plain MuJoCo")
    limit = no_load_speed(names["motor"], 24.0) / names["gear"].ratio
    assert 0.3 * limit < names["fastest"] < limit
    gravity = 0.8 * 9.81 * 0.15  # what the PD loop leaves to a pendulum's weight
    assert names["data"].qpos[0] == pytest.approx(2.5, abs=1.1 * gravity / 80.0)


def test_a_data_sheet_becomes_an_actuator_in_ten_lines(monkeypatch):
    assert len([line for line in snippet("From a data sheet").splitlines() if line]) <= 10
    monkeypatch.chdir(PAGE.parents[1])
    names = run("From a data sheet")
    assert 1.0 < names["torque"] < 1.3  # nine tenths of the no-load speed: the voltage allows less than 3 N m
    assert 'joint="knee"' in names["line"] and "gear='9.0'" in names["line"]


def test_the_callback_holds_a_pendulum_and_leaves():
    names = run("MuJoCo callback")
    gravity = 0.8 * 9.81 * 0.15
    assert names["data"].qpos[0] == pytest.approx(2.5, abs=1.1 * gravity / 80.0)
    assert names["mujoco"].get_mjcb_control() is None


def test_the_exported_lines_give_the_wanted_torque():
    names = run("MJCF export")
    bodies = "".join(
        f"<body><joint name='{name}' axis='0 1 0'/><geom size='.1'/></body>" for name in names["joints"]
    )
    text = f"<mujoco><worldbody>{bodies}</worldbody><actuator>{''.join(names['lines'])}</actuator></mujoco>"
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.ctrl[0], data.qvel[0] = names["volts"], 5.0
    mujoco.mj_forward(model, data)
    assert abs(names["volts"]) < names["elements"]["FL_calf_joint"].voltage
    assert data.qfrc_actuator[0] == pytest.approx(12.0)


@pytest.mark.slow  # importing mjlab and its task
def test_mjlab_configuration_builds():
    pytest.importorskip("torch", reason="needs PyTorch: pip install 'sprintlab[mjlab]'")
    pytest.importorskip("mjlab", reason="needs mjlab: pip install 'sprintlab[mjlab]'")
    names = run("mjlab")
    (own,) = names["task"].scene.entities["robot"].articulation.actuators
    joints = ["FR_hip_joint", "FL_calf_joint"]
    assert own.motors.parameters(joints)["gear_ratio"] == pytest.approx([6.0, 9.0], rel=0.1)
    assert len([line for line in snippet("mjlab").splitlines() if line]) <= 12


def test_newton_builds_the_pages_model():
    newton = pytest.importorskip("newton", reason="needs Newton 1.8")
    if not hasattr(newton, "ModelBuilder"):
        pytest.skip("needs Newton 1.8")
    gears = [
        ratio
        for actuator in run("Newton")["model"].actuators
        for ratio in actuator.clamping[0].gear_ratio.numpy()
    ]
    assert gears == pytest.approx([6.0, 9.0], rel=0.1)


def test_isaac_lab_builds_the_pages_group():
    if importlib.util.find_spec("isaaclab") is None:
        pytest.skip("needs Isaac Lab 3; tests/integrations/test_isaaclab.py has doubles of it")
    legs = run("Isaac Lab")["legs"]
    assert legs.armature["FL_calf_joint"] > legs.armature["FL_hip_joint"]


def test_playground_steps_the_pages_model():
    pytest.importorskip("jax", reason="needs JAX; tests/integrations/test_playground.py has doubles of it")
    assert 0.0 < float(run("MuJoCo Playground")["data"].qpos[0]) < 0.5
