"""The engine on a CPU against MuJoCo, the motor law and itself."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest
import torch
from benchmarks.engine_accuracy import acceleration_error

from sprintlab.core.errors import RobotModelError, SimulationError
from sprintlab.engine import PAIRS, Engine, EngineOptions
from sprintlab.engine.tree import read_tree
from sprintlab.motors import drive_torque
from sprintlab.robots import ModelOptions, build_model, load_robot, robot_names, soft_stop_torque

OUTPUTS = ("qpos", "qvel", "bristle", "gear_torque", "foot_force", "leg_distance", "power", "foot_position")


def options(robots: int, substeps: int = 20, timestep: float = 0.001, **others: object) -> EngineOptions:
    return EngineOptions(robots=robots, substeps=substeps, timestep=timestep, **others)


def scattered(engine: Engine, height: float, speed: float = 1.0, seed: int = 0) -> None:
    """Random poses, velocities and targets, at a height."""
    draw = np.random.default_rng(seed)
    n, joints = engine.robots, engine.target.shape[1]
    place = engine.qpos.double().numpy().copy()
    place[:, 2] = height
    place[:, 3:7] += draw.normal(0, 0.1, (n, 4))
    place[:, 3:7] /= np.linalg.norm(place[:, 3:7], axis=1)[:, None]
    place[:, 7:] += draw.uniform(-0.3, 0.3, (n, place.shape[1] - 7))
    engine.qpos.copy_(torch.tensor(place))
    engine.qvel.copy_(torch.tensor(draw.normal(0, speed, engine.qvel.shape)))
    engine.target += torch.tensor(draw.normal(0, 0.3, (n, joints)), dtype=engine.target.dtype)


@pytest.mark.parametrize("name", robot_names())
def test_accelerations_are_those_of_mujoco(name: str) -> None:
    assert acceleration_error(name) < 1e-5


@pytest.mark.parametrize("model", ["refined", "simplified-dc", "square"])
@pytest.mark.parametrize("name", ["bp2", "go1"])
def test_torques_are_those_of_the_motor_law(name: str, model: str) -> None:
    robot = load_robot(name)
    engine = Engine(robot, options(64, 1, 1e-5, motor_model=model), "cpu")
    scattered(engine, 5.0, speed=12.0)
    engine.target += torch.randn(engine.target.shape, generator=torch.Generator().manual_seed(2))
    joints = [engine.mj_model.joint(joint) for joint in robot.joint_names]
    position = engine.qpos[:, [int(joint.qposadr[0]) for joint in joints]].double().numpy()
    velocity = engine.qvel[:, [int(joint.dofadr[0]) for joint in joints]].double().numpy()
    engine.step()
    desired = robot.stiffness * (engine.target.double().numpy() - position) - robot.damping * velocity
    drive = drive_torque(robot.motors, robot.gear, desired, velocity, robot.bus_voltage, model)
    assert np.allclose(engine.torque.numpy(), drive.torque, rtol=2e-5, atol=2e-4)
    limited = np.abs(drive.motor_torque - desired / robot.gear.ratio) > 1e-4
    assert (engine.limit_share.numpy()[limited] == 1.0).all()


def test_end_stops_push_as_their_law_says() -> None:
    robot = load_robot("bp2")
    engine = Engine(robot, options(64, 1, 1e-5), "cpu", double=True)
    free = Engine(robot, options(64, 1, 1e-5), "cpu", double=True, given_torque=True)
    for one in (engine, free):
        scattered(one, 5.0, speed=3.0)
    depth = torch.linspace(-0.05, 0.12, 64, dtype=torch.float64)
    knee = int(engine.mj_model.joint("FL_knee").qposadr[0])
    engine.qpos[:, knee] = robot.position_limits[2, 1] - robot.soft_stop.zone + depth
    position, velocity = engine.qpos[:, knee].numpy().copy(), engine.qvel[:, knee - 1].numpy().copy()
    stop = soft_stop_torque(
        position[:, None], velocity[:, None], robot.position_limits[2:3], robot.soft_stop
    )[:, 0]
    friction = robot.dry_friction[2] * np.tanh(velocity / 0.2)
    before = engine.qvel.clone()
    free.qpos.copy_(engine.qpos)
    free.qvel.copy_(before)
    engine.step()
    free.given_torque[:, [int(engine.mj_model.joint(j).dofadr[0]) for j in robot.joint_names]] = _all_torques(
        engine, free
    )
    free.given_torque[:, knee - 1] = torch.tensor(engine.torque[:, 2].numpy() + stop - friction)
    free.step()
    assert np.allclose(engine.qvel[:, knee - 1], free.qvel[:, knee - 1], atol=1e-4)
    assert np.allclose(engine.stop_depth[:, 2], depth.clamp(min=0.0), atol=1e-12)


def _all_torques(engine: Engine, free: Engine) -> torch.Tensor:
    joints = [int(engine.mj_model.joint(joint).dofadr[0]) for joint in engine.robot.joint_names]
    friction = torch.tensor(engine.robot.dry_friction) * torch.tanh(free.qvel[:, joints] / 0.2)
    return engine.torque - friction


@pytest.mark.parametrize("name", ["bp2", "bp2-waist"])
def test_the_same_run_gives_the_same_bits_in_any_batch(name: str) -> None:
    whole = Engine(load_robot(name), options(21), "cpu")
    scattered(whole, 0.6)
    parts = [Engine(load_robot(name), options(count), "cpu") for count in (13, 8)]
    for part, rows in zip(parts, (slice(0, 13), slice(13, 21)), strict=True):
        for field in ("qpos", "qvel", "target"):
            getattr(part, field).copy_(getattr(whole, field)[rows])
    for _ in range(10):
        for engine in (whole, *parts):
            engine.step()
    for field in OUTPUTS:
        assert torch.equal(getattr(whole, field), torch.cat([getattr(part, field) for part in parts])), field


@pytest.mark.parametrize("name", robot_names())
def test_robots_stand_and_feet_carry_their_weight(name: str) -> None:
    engine = Engine(load_robot(name), options(1), "cpu")
    for _ in range(150):
        engine.step()
    assert engine.foot_force.sum().item() == pytest.approx(1.0, abs=0.02)
    assert (engine.stance > 0.999).all()
    assert (engine.qvel.abs() < 0.1).all()
    assert (engine.pad_deflection < 0.002).all()


def test_places_and_distances_are_those_of_mujoco() -> None:
    parts = ("thigh", "shank", "foot")
    for name in ("bp2", "bp2-waist"):
        robot = load_robot(name)
        engine = Engine(robot, options(16, 1, 1e-5), "cpu")
        scattered(engine, 1.0)
        engine.step()
        model = build_model(robot, ModelOptions(collisions="full"))
        data = mujoco.MjData(model)
        for row in range(16):
            data.qpos, data.qvel = engine.qpos[row].numpy(), engine.qvel[row].numpy()
            mujoco.mj_forward(model, data)
            feet = np.array([data.geom(f"{leg}_foot").xpos for leg in robot.leg_names])
            knees = np.array([data.body(f"{leg}_shank").xpos for leg in robot.leg_names])
            assert np.allclose(engine.foot_position[row], feet, atol=1e-5)
            assert np.allclose(engine.knee_position[row], knees, atol=1e-5)
            _check_velocities(engine, row, model, data)
            for pair, (one, two) in enumerate(PAIRS):
                distance = min(
                    mujoco.mj_geomDistance(model, data, model.geom(f"{robot.leg_names[one]}_{a}").id,
                                           model.geom(f"{robot.leg_names[two]}_{b}").id, 10.0, None)
                    for a in parts for b in parts
                )  # fmt: skip
                # hips stay 0.2 m apart: the engine does not look at them
                near = min(engine.leg_distance[row, pair].item(), 0.2)
                assert near == pytest.approx(min(distance, 0.2), abs=5e-4)


def _check_velocities(engine: Engine, row: int, model: mujoco.MjModel, data: mujoco.MjData) -> None:
    jacobian = np.zeros((3, model.nv))
    for foot, leg in enumerate(engine.robot.leg_names):
        geom = model.geom(f"{leg}_foot").id
        mujoco.mj_jac(model, data, jacobian, None, data.geom_xpos[geom], model.geom_bodyid[geom])
        assert np.allclose(engine.foot_velocity[row, foot], jacobian @ data.qvel, atol=1e-3)


def test_a_delayed_target_acts_late() -> None:
    engine = Engine(load_robot("bp2"), options(3, 4), "cpu")
    engine.target += 0.2
    engine.delay.copy_(torch.tensor([0, 2, 4]))
    engine.qpos[:, 2] = 2.0
    engine.step()
    early, middle, late = engine.qvel[:, 7].tolist()
    assert early > middle > late


def test_what_cannot_be_expressed_is_refused_in_one_sentence() -> None:
    floating = "<mujoco><worldbody><body name='b'><freejoint/><geom size='.1'/>{}</body></worldbody></mujoco>"
    with pytest.raises(RobotModelError, match="four legs, not 0"):
        read_tree(mujoco.MjModel.from_xml_string(floating.format("")))
    leg = "<body name='leg{}'><joint name='j{}' axis='1 0 0'/><geom type='{}' size='.1 .1 .1'/></body>"
    boxes = "".join(leg.format(i, i, "box") for i in range(4))
    with pytest.raises(RobotModelError, match="leg0 needs one sphere for a foot, not 0"):
        read_tree(mujoco.MjModel.from_xml_string(floating.format(boxes)))
    model = mujoco.MjModel.from_xml_string(
        floating.format("".join(leg.format(i, i, "sphere") for i in range(4)))
    )
    model.body_mass[3] = 0.0
    with pytest.raises(RobotModelError, match="leg1 has a mass of 0 kg"):
        read_tree(model)


def test_without_a_compiler_one_sentence_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    with pytest.raises(SimulationError, match="install g\\+\\+ or clang"):
        Engine(load_robot("bp2"), options(1), "cpu")


def test_legs_may_differ_in_their_numbers() -> None:
    robot = load_robot("go1")
    gear = replace(robot.gear, ratio=np.array([6.3, 6.3, 9.5, 6.3, 6.3, 9.0, 6.3, 6.3, 9.5, 6.3, 6.3, 9.5]))
    engine = Engine(replace(robot, gear=gear), options(1, 1), "cpu")
    engine.target += 3.0
    engine.qpos[:, 2] = 2.0
    engine.step()
    left, right = engine.torque[0, 2].item(), engine.torque[0, 5].item()
    assert right / left == pytest.approx(9.0 / 9.5, rel=1e-4)
