"""The snippets of docs/integrations.md, each run where what it needs is installed."""

import json
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
from sprintlab.robots import load_robot

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "integrations.md"
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
    (actuator,) = run("Newton")["model"].actuators
    assert type(actuator.clamping[0]).__name__ == "PmsmClamping"
    assert actuator.clamping[0].gear_ratio.numpy() == pytest.approx([6.0])


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


class ActuatorOfIsaacLab:
    """What Isaac Lab's ``IdealPDActuator`` is to a subclass, in release 2 and in release 3.

    Both make their buffers in the constructor, call ``_clip_effort`` between the two of them, and return the
    torque in the action they were given, with the targets taken away.
    """

    def _prepare(self, cfg, joint_names, num_envs, stiffness, damping):
        import torch

        self.cfg, self._num_envs, self._joint_names = cfg, num_envs, joint_names
        self.stiffness = torch.full((num_envs, len(joint_names)), cfg.stiffness or stiffness)
        self.damping = torch.full_like(self.stiffness, cfg.damping or damping)
        self.computed_effort = torch.zeros_like(self.stiffness)
        self.applied_effort = torch.zeros_like(self.stiffness)

    def reset(self, env_ids):
        """Nothing to reset."""

    def compute(self, control_action, joint_pos, joint_vel):
        error_pos = control_action.joint_positions - joint_pos
        error_vel = control_action.joint_velocities - joint_vel
        wanted = self.stiffness * error_pos + self.damping * error_vel
        self.computed_effort = wanted + control_action.joint_efforts
        self.applied_effort = self._clip_effort(self.computed_effort)
        control_action.joint_efforts = self.applied_effort
        control_action.joint_positions = control_action.joint_velocities = None
        return control_action


class ActuatorOfRelease2(ActuatorOfIsaacLab):
    def __init__(
        self,
        cfg,
        joint_names,
        joint_ids,
        num_envs,
        device,
        stiffness=0.0,
        damping=0.0,
        armature=0.0,
        friction=0.0,
        dynamic_friction=0.0,
        viscous_friction=0.0,
        effort_limit=np.inf,
        velocity_limit=np.inf,
    ):
        self._prepare(cfg, joint_names, num_envs, stiffness, damping)


class ActuatorOfRelease3(ActuatorOfIsaacLab):
    def __init__(
        self,
        cfg,
        joint_names,
        joint_ids,
        num_envs,
        device,
        stiffness=0.0,
        damping=0.0,
        actuator_effort_limit=None,
        actuator_velocity_limit=None,
        effort_limit=None,
        velocity_limit=None,
    ):
        self._prepare(cfg, joint_names, num_envs, stiffness, damping)


LIMITS = {  # what Isaac Lab's articulation hands over beside the gains
    ActuatorOfRelease2: {"armature": 0.0, "friction": 0.0, "effort_limit": 1e9, "velocity_limit": 1e9},
    ActuatorOfRelease3: {"actuator_effort_limit": 1e9, "actuator_velocity_limit": 1e9},
}


@pytest.fixture(params=LIMITS, ids=["release 2", "release 3"])
def isaac_lab(request, monkeypatch):
    """What the snippet uses of Isaac Lab: a PD actuator that clips, its configuration, ``configclass``."""
    pytest.importorskip("torch", reason="needs PyTorch: pip install 'sprintlab[train]'")

    @dataclass
    class ActuatorBaseCfg:
        stiffness: float = 40.0
        damping: float = 1.0

    actuators, utilities = ModuleType("isaaclab.actuators"), ModuleType("isaaclab.utils")
    actuators.IdealPDActuator, actuators.ActuatorBaseCfg = request.param, ActuatorBaseCfg
    utilities.configclass = dataclass
    for module in (ModuleType("isaaclab"), actuators, utilities):
        monkeypatch.setitem(sys.modules, module.__name__, module)
    return request.param


def test_isaac_lab_actuator_gives_the_law(isaac_lab, tmp_path):
    import torch

    save_motor(MOTOR, tmp_path / "motor.toml")
    names = run("Isaac Lab")
    configuration = names["PmsmMotorCfg"](motor_file=str(tmp_path / "motor.toml"), bus_voltage=24.0)
    actuator = configuration.class_type(
        cfg=configuration,
        joint_names=["hip", "thigh", "calf"],
        joint_ids=slice(None),
        num_envs=5,
        device="cpu",
        stiffness=0.0,
        damping=0.0,
        **LIMITS[isaac_lab],
    )
    random = np.random.default_rng(0)
    position, target, speed = (random.normal(0.0, scale, (5, 3)) for scale in (1.0, 1.0, 20.0))
    action = SimpleNamespace(
        joint_positions=torch.tensor(target),
        joint_velocities=torch.zeros(5, 3),
        joint_efforts=torch.zeros(5, 3),
    )
    done = actuator.compute(action, torch.tensor(position), torch.tensor(speed))
    assert done is action and done.joint_positions is None
    given = actuator.applied_effort
    assert torch.equal(done.joint_efforts, given)
    wanted = 40.0 * (target - position) - speed
    expected = drive_torque(MOTOR, Gear(ratio=6.0, efficiency=0.95), wanted, speed, 24.0).torque
    assert given.numpy() == pytest.approx(expected, rel=1e-4, abs=1e-4)
    assert not np.allclose(expected, wanted)
