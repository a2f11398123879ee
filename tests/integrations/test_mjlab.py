"""The motor and the schedule as mjlab terms; skipped where mjlab is not installed."""

import importlib.util
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from sprintlab.core.errors import InvalidValueError
from sprintlab.motors import (
    MOTOR_MODELS,
    Gear,
    PmsmParameters,
    drive_torque,
    stack_motors,
    torque_limits,
)
from sprintlab.robots import JointMotors

torch = pytest.importorskip("torch", reason="the mjlab terms need PyTorch: pip install 'sprintlab[mjlab]'")
if importlib.util.find_spec("mjlab") is None:
    pytest.skip("needs mjlab: pip install 'sprintlab[mjlab]'", allow_module_level=True)

ENVIRONMENTS = 3
TIMESTEP = 0.005  # [s]
EXAMPLE = Path(__file__).parents[2] / "examples" / "mjlab_go1_refined_motor.py"


@pytest.fixture(scope="module", autouse=True)
def mjlab():
    """Imported before the first test: it takes three seconds."""
    global ActuatorCmd, AdaptiveVelocityCommandCfg, FusedActuatorGroup, PmsmActuatorCfg, TransmissionType
    global actuator_type, randomize_bus_voltage
    from mjlab.actuator import ActuatorCmd
    from mjlab.actuator.actuator import TransmissionType
    from mjlab.actuator.fused_group import FusedActuatorGroup

    from sprintlab.integrations.mjlab import (
        AdaptiveVelocityCommandCfg,
        PmsmActuatorCfg,
        actuator_type,
        randomize_bus_voltage,
    )


def motor(**changes):
    values = {
        "pole_pairs": 21, "stator_resistance": 0.13, "q_axis_inductance": 80e-6, "flux_linkage": 2.87e-3,
        "peak_torque": 3.95, "saturation": 0.12, "rotor_inertia": 1e-4,
    }  # fmt: skip
    return PmsmParameters(**{**values, **changes})


def motors(one=None, ratio=6.0, **names):
    return JointMotors(
        motor=one or motor(), gear=Gear(ratio=ratio, efficiency=0.9), bus_voltage=20.0, **names
    )


def configuration(**changes):
    values = {"target_names_expr": (".*",), "stiffness": 20.0, "damping": 1.0, "motors": motors()}
    return PmsmActuatorCfg(**{**values, **changes})


@pytest.fixture
def build():
    """An initialized actuator of two joints; mjlab's entity is reduced to what an actuator asks of it."""

    def make(first_joint=0, **changes):
        entity = SimpleNamespace(indexing=SimpleNamespace(ctrl_ids=torch.arange(8)))
        actuator = configuration(**changes).build(entity, [first_joint, first_joint + 1], ["a", "b"])
        actuator._mjs_actuators = [SimpleNamespace(id=first_joint), SimpleNamespace(id=first_joint + 1)]
        described = SimpleNamespace(opt=SimpleNamespace(timestep=TIMESTEP))
        actuator.initialize(described, None, SimpleNamespace(nworld=ENVIRONMENTS), "cpu")
        return actuator

    return make


def random_command(joints, seed=0):
    random = np.random.default_rng(seed)

    def tensor(scale):
        return torch.tensor(random.normal(0.0, scale, (ENVIRONMENTS, joints)), dtype=torch.float)

    return ActuatorCmd(
        position_target=tensor(1.0),
        velocity_target=torch.zeros(ENVIRONMENTS, joints),
        effort_target=torch.zeros(ENVIRONMENTS, joints),
        pos=tensor(1.0),
        vel=tensor(20.0),
    )


def expected_torque(command, motors, ratio, bus_voltage, model):
    """The same by NumPy in double precision."""
    position, target, speed = (
        value.numpy().astype(float) for value in (command.pos, command.position_target, command.vel)
    )
    gear = Gear(ratio=np.asarray(ratio), efficiency=np.full(len(ratio), 0.9))
    limit = gear.ratio * motors.peak_torque
    desired = np.clip(20.0 * (target - position) - speed, -limit, limit)
    return drive_torque(motors, gear, desired, speed, bus_voltage, model=model).torque


@pytest.mark.parametrize("model", MOTOR_MODELS)
def test_groups_with_different_motors_fuse_into_one_law_which_is_that_of_the_motor_package(build, model):
    strong = motor(peak_torque=8.0, flux_linkage=5e-3)
    groups = [build(model=model), build(first_joint=2, motors=motors(strong, ratio=9.0), model=model)]
    fused, remaining = FusedActuatorGroup.process(groups)
    assert remaining == () and len(fused._groups) == 1
    fused.initialize(ENVIRONMENTS, "cpu")
    group = fused._groups[0]
    command = random_command(4)
    torque = group.actuator_type.control_law(group.params, command)
    four = stack_motors([motor(), motor(), strong, strong])
    expected = expected_torque(command, four, [6.0, 6.0, 9.0, 9.0], 20.0, model)
    assert torque.numpy() == pytest.approx(expected, rel=1e-4, abs=1e-4)


def test_each_joint_has_the_motor_of_its_name(build):
    """In the order of mjlab's joints, not in that of the motors."""
    strong = motor(peak_torque=8.0, rotor_inertia=3e-4)
    several = motors(stack_motors([strong, motor()]), np.array([9.0, 6.0]), names=("b", "a"))
    actuator = build(motors=several)
    assert actuator.peak_torque[0].tolist() == pytest.approx([3.95, 8.0])
    assert actuator.force_limit[0].tolist() == pytest.approx([6.0 * 3.95, 9.0 * 8.0])
    spec = mujoco.MjSpec.from_string(
        "<mujoco><worldbody><body><joint name='a'/><joint name='b'/><geom size='.1'/></body></worldbody>"
        "</mujoco>"
    )
    actuator.edit_spec(spec, ["a", "b"])
    assert [joint.armature for joint in spec.joints] == pytest.approx([36.0 * 1e-4, 81.0 * 3e-4])
    chosen = build(effort_limit=3.0)
    assert chosen.force_limit[0].tolist() == [3.0, 3.0]
    with pytest.raises(InvalidValueError, match="a, b"):
        build(motors=replace(several, names=("c", "d")))


def test_mjlabs_data_sheet_becomes_a_motor():
    """Stall torque, no-load speed and, without inductance, the straight line of MuJoCo's own motor."""
    from mjlab.actuator.builtin_actuator import DcMotorDatasheetParams

    from sprintlab.integrations.mjlab import datasheet_motors

    sheet = DcMotorDatasheetParams(nominal_voltage=24.0, stall_torque=5.0, no_load_speed=180.0)
    found = datasheet_motors(
        sheet,
        pole_pairs=10,
        q_axis_inductance=1e-4,
        peak_torque=6.0,
        rotor_inertia=1e-4,
        gear=Gear(ratio=6.0, efficiency=1.0),
    )
    speed = np.linspace(0.0, 180.0, 7)
    line = 5.0 * (1.0 - speed / 180.0)
    _, simple = torque_limits(found.motor, speed, found.bus_voltage, "simplified-dc")
    _, refined = torque_limits(found.motor, speed, found.bus_voltage)
    assert simple == pytest.approx(line, abs=1e-9)
    assert refined[[0, -1]] == pytest.approx(line[[0, -1]], abs=1e-9) and np.all(refined[1:-1] < line[1:-1])


def test_bus_voltages_are_drawn_one_an_environment_and_reach_the_fused_law(build):
    groups = [build(), build(first_joint=2)]
    fused, _ = FusedActuatorGroup.process(groups)
    fused.initialize(ENVIRONMENTS, "cpu")
    robot = SimpleNamespace(actuators=groups)
    environment = SimpleNamespace(num_envs=ENVIRONMENTS, device="cpu", scene={"robot": robot})
    randomize_bus_voltage(environment, None, (18.0, 25.0))
    drawn = groups[0].bus_voltage
    assert torch.equal(drawn, groups[1].bus_voltage) and torch.equal(drawn[:, 0], drawn[:, 1])
    assert len(set(drawn[:, 0].tolist())) == ENVIRONMENTS
    assert float(drawn.min()) >= 18.0 and float(drawn.max()) <= 25.0
    before = drawn.clone()
    randomize_bus_voltage(environment, torch.tensor([2]), (30.0, 31.0))
    assert torch.equal(groups[0].bus_voltage[:2], before[:2]) and float(groups[0].bus_voltage[2, 0]) >= 30.0
    assert (fused._groups[0].params["bus_voltage"][2] >= 30.0).all()
    with pytest.raises(InvalidValueError, match="voltage_range"):
        randomize_bus_voltage(environment, None, (25.0, 18.0))
    robot.actuators = []
    with pytest.raises(InvalidValueError, match="PMSM"):
        randomize_bus_voltage(environment, None, (18.0, 25.0))


@pytest.fixture
def robot_data():
    return SimpleNamespace(root_link_lin_vel_b=torch.zeros(64, 3), root_link_ang_vel_b=torch.zeros(64, 3))


@pytest.fixture
def command_term(robot_data):
    """A command term of 64 robots whose velocity a test sets."""

    def make(**changes):
        torch.manual_seed(0)
        environment = SimpleNamespace(
            num_envs=64,
            device="cpu",
            step_dt=0.02,
            max_episode_length_s=20.0,
            scene={"robot": SimpleNamespace(data=robot_data)},
        )
        return AdaptiveVelocityCommandCfg(**changes).build(environment)

    return make


def test_a_reset_draws_only_for_the_environments_reset(command_term):
    term = command_term()
    term.compute(dt=0.02)
    before = term.command.clone()
    chosen = torch.tensor([3, 5])
    metrics = term.reset(chosen)
    term.compute(dt=0.0, env_ids=chosen)
    untouched = torch.ones(64, dtype=torch.bool)
    untouched[chosen] = False
    assert torch.equal(term.command[untouched], before[untouched])
    assert not torch.equal(term.command[chosen], before[chosen])
    assert set(metrics) == {"error_vel_x", "error_vel_yaw"}
    assert not term._reset_mask.any()


@pytest.mark.slow
def test_the_example_trains_mjlabs_go1(tmp_path, monkeypatch):
    spec = importlib.util.spec_from_file_location("mjlab_go1_refined_motor", EXAMPLE)
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    settings = example.unitree_go1_ppo_runner_cfg()
    settings.num_steps_per_env = 2
    monkeypatch.setattr(example, "unitree_go1_ppo_runner_cfg", lambda: settings)
    example.train(4, 2, "refined", "cpu", tmp_path)
    checkpoint = torch.load(sorted(tmp_path.glob("model_*.pt"))[-1], weights_only=False)
    weights = checkpoint["actor_state_dict"]
    assert all(torch.isfinite(value).all() for value in weights.values() if value.is_floating_point())
    assert list(tmp_path.glob("events.out.tfevents*"))
