"""The snippets of docs/integrations.md, each run where what it needs is installed."""

import importlib.util
import json
import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

from sprintlab.integrations.mjcf import dc_motor_excess
from sprintlab.motors import load_library_motor, no_load_speed
from sprintlab.robots import load_robot

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "integrations.md"


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


def test_every_framework_has_a_snippet():
    headings = (
        "From a data sheet",
        "Plain MuJoCo",
        "MuJoCo callback",
        "MJCF export",
        "mjlab",
        "Newton",
        "Isaac Lab",
        "MuJoCo Playground",
    )
    assert PAGE.read_text("utf-8").count("```python") == len(headings)
    assert all(snippet(heading) for heading in headings)


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


def test_what_the_export_loses_is_what_the_page_says():
    rows = re.findall(r"^\| `([a-z][\w-]+)` \| (.*) \|$", PAGE.read_text("utf-8"), re.MULTILINE)
    assert len(rows) == 7
    for name, cells in rows:
        actuator = load_library_motor(name)
        excess = dc_motor_excess(actuator.motor, actuator.gear, actuator.bus_voltage)
        columns = ("driving", "driving_mean", "braking", "stalled")
        assert cells.split(" | ") == [f"{abs(round(100.0 * excess[column])):d} %" for column in columns]


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


def measured(name):
    return json.loads((ROOT / "results" / "integrations" / f"{name}.json").read_text(encoding="utf-8"))


def row(name):
    """Cells behind the actuator's or clamping stage's name."""
    return re.search(rf"^\| `{name}` \| (.*) \|$", PAGE.read_text("utf-8"), re.MULTILINE)[1].split(" | ")


def cells(held, fastest, share):
    return [f"{held:.2f} m/s", f"{fastest:.1f} rad/s", f"{100.0 * share:.1f} %"]


def test_the_jump_of_plain_mujoco_is_what_was_measured(flowing):
    found, page = measured("mujoco-go2"), flowing("docs/integrations.md")
    robot = load_robot("go2")
    own, refined = (f"{100.0 * found[f'rise_{name}_m']:.0f} cm" for name in ("own", "refined"))
    assert f"jumps {own} on the first and {refined} on the second" in page
    slowest = float(np.min(no_load_speed(robot.motors, robot.bus_voltage) / robot.gear.ratio))
    assert (
        f"up to {found['fastest_joint_own_rad_s']:.0f} rad/s; their motors reach {slowest:.1f} rad/s" in page
    )
    assert f"{100.0 * found['impossible_work_share']:.0f} % lies outside" in page
    assert f"the same motors jump {100.0 * found['rise_dcmotor_m']:.0f} cm" in page


@pytest.mark.parametrize(
    ("law", "name"),
    [
        ("position", "BuiltinPositionActuatorCfg"),
        ("dc_motor", "DcMotorActuatorCfg"),
        ("refined", "PmsmActuatorCfg"),
    ],
)
def test_the_walk_of_mjlabs_go1_is_what_was_measured(law, name):
    found = measured("mjlab-go1")[f"{law}_1.5"]
    keys = ("held_m_s", "fastest_calf_rad_s", "impossible_work_share")
    assert row(name) == cells(*(found[key] for key in keys))


@pytest.mark.parametrize(
    ("law", "name"),
    [
        ("peak_torque", "ClampingMaxEffort"),
        ("straight_line", "ClampingDCMotor"),
        ("refined", "PmsmClamping"),
    ],
)
def test_the_walk_of_newtons_anymal_is_what_was_measured(law, name):
    found = measured("newton-anymal")
    keys = (f"held_{law}_m_s", f"fastest_joint_{law}_rad_s", f"impossible_work_share_{law}")
    assert row(name) == cells(*(found[key] for key in keys))


def test_what_the_page_says_of_both_walks_is_what_was_measured(flowing):
    page, robot = flowing("docs/integrations.md"), load_robot("go1")
    fastest = measured("mjlab-go1")["position_1.5"]["fastest_calf_rad_s"]
    calf = float(np.min(no_load_speed(robot.motors, robot.bus_voltage) / robot.gear.ratio))
    assert f"at up to {fastest:.1f} rad/s; their motors reach {calf:.1f} rad/s without load" in page
    found = measured("newton-anymal")
    least, most = (found[f"impossible_work_share_straight_line_{end}"] for end in ("least", "most"))
    assert f"share is {100.0 * least:.1f} to {100.0 * most:.1f} %" in page
    fastest = found["fastest_joint_peak_torque_rad_s"]
    assert f"up to {fastest:.1f} rad/s; their drives reach 7.5 rad/s without load" in page


def test_the_costs_are_what_was_measured():
    found = measured("cost")
    titles = ("Isaac Lab", "mjlab", "Newton", "Playground", "plain MuJoCo, one robot")
    page = PAGE.read_text("utf-8")
    for title, guest in zip(titles, ("isaaclab", "mjlab", "newton", "playground", "mujoco"), strict=True):
        times = list(found[guest]["microseconds_per_step"].values())
        line = times[1] if len(times) > 2 else None
        shown = ["-" if time is None else f"{time:.0f}" for time in (times[0], line, times[-1])]
        assert f"| {title} | {' | '.join(shown)} |" in page


def test_isaac_lab_builds_the_pages_group():
    if importlib.util.find_spec("isaaclab") is None:
        pytest.skip("needs Isaac Lab 3; tests/integrations/test_isaaclab.py has doubles of it")
    legs = run("Isaac Lab")["legs"]
    assert legs.armature["FL_calf_joint"] > legs.armature["FL_hip_joint"]


def test_playground_steps_the_pages_model():
    pytest.importorskip("jax", reason="needs JAX; tests/integrations/test_playground.py has doubles of it")
    assert 0.0 < float(run("MuJoCo Playground")["data"].qpos[0]) < 0.5
