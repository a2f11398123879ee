"""The snippets of docs/integrations.md, each run where what it needs is installed."""

import re
import sys
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType, SimpleNamespace

import mujoco
import numpy as np
import pytest

from sprintlab.integrations.mjcf import dc_motor_excess
from sprintlab.motors import Gear, PmsmParameters, drive_torque, load_library_motor, no_load_speed, save_motor

PAGE = Path(__file__).resolve().parents[2] / "docs" / "integrations.md"
MOTOR = PmsmParameters(
    pole_pairs=21,
    stator_resistance=0.13,
    q_axis_inductance=80e-6,
    flux_linkage=2.87e-3,
    peak_torque=3.0,
    saturation=0.1,
    rotor_inertia=6.3e-5,
)


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


def test_the_exported_line_gives_the_wanted_torque():
    names = run("MJCF export")
    text = (
        "<mujoco><worldbody><body><joint name='hip' axis='0 1 0'/><geom size='.1'/></body></worldbody>"
        f"<actuator>{names['line']}</actuator></mujoco>"
    )
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.ctrl[0], data.qvel[0] = names["volts"], 20.0
    mujoco.mj_forward(model, data)
    assert abs(names["volts"]) < names["element"].voltage
    assert data.qfrc_actuator[0] == pytest.approx(12.0)


def test_what_the_export_loses_is_what_the_page_says():
    rows = re.findall(r"^\| `([\w-]+)` \| (.*) \|$", PAGE.read_text("utf-8"), re.MULTILINE)
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
    task = run("mjlab")["task"]
    hips, calves = task.scene.entities["robot"].articulation.actuators
    assert calves.armature == pytest.approx(81.0 * 1.1e-4)
    assert hips.effort_limit == pytest.approx(6.0 * 3.95)
    assert type(task.commands["twist"]).__name__ == "AdaptiveVelocityCommandCfg"
    assert "bus_voltage" in task.events and "command_vel" not in task.curriculum


def test_newton_builds_the_pages_model():
    newton = pytest.importorskip("newton", reason="needs Newton 1.8")
    if not hasattr(newton, "ModelBuilder"):
        pytest.skip("needs Newton 1.8")
    (actuator,) = run("Newton")["model"].actuators
    assert type(actuator.clamping[0]).__name__ == "PmsmClamping"
    assert actuator.clamping[0].gear_ratio.numpy() == pytest.approx([6.0])


@pytest.fixture
def isaac_lab(monkeypatch):
    """What the snippet uses of Isaac Lab 2: a PD actuator that clips, its configuration, ``configclass``."""
    torch = pytest.importorskip("torch", reason="needs PyTorch: pip install 'sprintlab[train]'")

    class IdealPDActuator:
        def __init__(self, cfg, environments, joints):
            self.cfg = cfg
            self.computed_effort = torch.zeros(environments, joints)
            self.stiffness, self.damping = cfg.stiffness, cfg.damping

        def compute(self, control_action, joint_pos, joint_vel):
            self.computed_effort = (
                self.stiffness * (control_action.joint_positions - joint_pos)
                + self.damping * (control_action.joint_velocities - joint_vel)
                + control_action.joint_efforts
            )
            control_action.joint_efforts = self._clip_effort(self.computed_effort)
            return control_action

    @dataclass
    class IdealPDActuatorCfg:
        stiffness: float = 40.0
        damping: float = 1.0

    actuators, utilities = ModuleType("isaaclab.actuators"), ModuleType("isaaclab.utils")
    actuators.IdealPDActuator, actuators.IdealPDActuatorCfg = IdealPDActuator, IdealPDActuatorCfg
    utilities.configclass = dataclass
    for module in (ModuleType("isaaclab"), actuators, utilities):
        monkeypatch.setitem(sys.modules, module.__name__, module)
    return torch


def test_isaac_lab_actuator_gives_the_law(isaac_lab, tmp_path):
    torch = isaac_lab
    save_motor(MOTOR, tmp_path / "motor.toml")
    names = run("Isaac Lab")
    configuration = names["PmsmMotorCfg"](motor_file=str(tmp_path / "motor.toml"), bus_voltage=24.0)
    actuator = configuration.class_type(configuration, 5, 3)
    random = np.random.default_rng(0)
    position, target, speed = (random.normal(0.0, scale, (5, 3)) for scale in (1.0, 1.0, 20.0))
    action = SimpleNamespace(
        joint_positions=torch.tensor(target),
        joint_velocities=torch.zeros(5, 3),
        joint_efforts=torch.zeros(5, 3),
    )
    given = actuator.compute(action, torch.tensor(position), torch.tensor(speed)).joint_efforts
    wanted = 40.0 * (target - position) - speed
    expected = drive_torque(MOTOR, Gear(ratio=6.0, efficiency=0.95), wanted, speed, 24.0).torque
    assert given.numpy() == pytest.approx(expected, rel=1e-4, abs=1e-4)
    assert not np.allclose(expected, wanted)
