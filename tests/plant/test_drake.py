"""The second engine agrees with MuJoCo where both must agree: bodies, rotors, joints, springs, pads."""

from collections.abc import Sequence

import mujoco
import numpy as np
import pytest
from benchmarks.foot_drop import drop_model, drop_test, exact_drop

from sprintlab.control import load_policy, shipped_policy
from sprintlab.core.errors import SprintlabError
from sprintlab.evaluation.trial import TrialRequest, run_trial
from sprintlab.plant import PlantOptions, TrialSettings, check_engine, on_engine, open_plant
from sprintlab.robots import ModelOptions, RobotDescription, build_model, load_robot, robot_spec
from sprintlab.robots.foot import FootContact

pytest.importorskip("pydrake", reason="the second engine needs drake: pip install 'sprintlab[drake]'")

from sprintlab.plant.drake.assembly import rotors_of
from sprintlab.plant.drake.engine import DrakeEngine

ROBOTS = ("bp2", "go1")
TIMESTEP = 0.0005


@pytest.fixture(scope="module", params=ROBOTS)
def robot(request: pytest.FixtureRequest) -> RobotDescription:
    return load_robot(request.param)


def engine_of(model: mujoco.MjModel, robot: RobotDescription, timestep: float = TIMESTEP) -> DrakeEngine:
    names = {model.joint(index).name for index in range(model.njnt)}
    rotors = {name: rotor for name, rotor in rotors_of(robot).items() if name in names}
    return DrakeEngine(model, timestep, rotors=rotors)


def hung_robot(robot: RobotDescription, joints: Sequence[str], **options: object) -> mujoco.MjModel:
    """The robot with its trunk held in the air, all joints but these fixed at zero."""
    spec = robot_spec(robot, ModelOptions(timestep=5e-5, **options))
    for actuator in list(spec.actuators):
        spec.delete(actuator)
    for key in list(spec.keys):
        spec.delete(key)
    for joint in list(spec.joints):
        if joint.name not in joints:
            spec.delete(joint)
    spec.body("trunk").pos = (0.0, 0.0, 2.0)
    return spec.compile()


def courses(
    model: mujoco.MjModel, robot: RobotDescription, start: np.ndarray, steps: int, timestep: float = TIMESTEP
) -> tuple[np.ndarray, np.ndarray]:
    """Joint positions ``(steps, nq)`` from rest in MuJoCo and in Drake, at Drake's steps."""
    data, engine = mujoco.MjData(model), engine_of(model, robot, timestep)
    data.qpos[:] = start
    position, velocity = start.copy(), np.zeros_like(start)
    expected, shown = [], []
    for _ in range(steps):
        mujoco.mj_step(model, data, nstep=round(timestep / model.opt.timestep))
        expected.append(data.qpos.copy())
        engine.step(position, velocity, np.zeros_like(start))
        shown.append(position.copy())
    return np.array(expected), np.array(shown)


def poses(robot: RobotDescription, model: mujoco.MjModel, count: int) -> list[np.ndarray]:
    """Random states of the whole robot, away from the joints' limits."""
    random = np.random.default_rng(7)
    drawn = []
    for _ in range(count):
        position = model.key("stand").qpos.copy()
        position[:3] += random.uniform(-1.0, 1.0, 3)
        position[3:7] = random.normal(size=4)
        position[3:7] /= np.linalg.norm(position[3:7])
        position[7:] += random.uniform(-0.2, 0.2, len(position) - 7)
        drawn.append(position)
    return drawn


def test_reflected_inertia(robot: RobotDescription) -> None:
    """A torque on each joint, and a force and a twist on the trunk, accelerate the free robot alike."""
    model = build_model(robot, ModelOptions(dry_friction=False, joint_limits=False))
    model.opt.gravity[:], model.dof_damping[:] = 0.0, 0.0
    data, engine = mujoco.MjData(model), engine_of(model, robot, 1e-5)
    position = poses(robot, model, 1)[0]
    position[2] = 3.0
    springs = [model.joint(name).qposadr[0] for name in robot.spring_joint_names]
    position[springs] = model.qpos_spring[springs]
    for dof in range(model.nv):
        data.qpos[:], data.qvel[:], data.qfrc_applied[:] = position, 0.0, 0.0
        data.qfrc_applied[dof] = 1.0
        mujoco.mj_forward(model, data)
        moved, velocity = position.copy(), np.zeros(model.nv)
        engine.step(moved, velocity, data.qfrc_applied)
        assert velocity / 1e-5 == pytest.approx(data.qacc, abs=0.01 * np.abs(data.qacc).max())


def test_drop_of_a_single_leg(robot: RobotDescription) -> None:
    """A limp leg falls from the side, with joint friction, spring and hard limits."""
    leg = robot.leg_names[0]
    names = [name for name in (*robot.joint_names, *robot.spring_joint_names) if name.startswith(leg)]
    model = hung_robot(robot, names)
    start = np.array([{"abad": 0.5, "hip": 1.2, "knee": -1.4}.get(n.split("_")[1], 0.05) for n in names])
    order = [model.joint(name).qposadr[0] for name in names]
    start[order] = start.copy()
    expected, shown = courses(model, robot, start, 600)
    swing = np.ptp(expected, axis=0).max()
    assert swing > 0.5
    assert np.abs(shown - expected).max() < 0.01 * swing


@pytest.mark.parametrize("along", [0.0, 3.0, 8.0])
@pytest.mark.parametrize("speed", [1.0, 4.0, 8.0])
def test_drop_is_the_exact_solution(speed: float, along: float) -> None:
    """Peak force and rebound of a leg's mass on the pad, straight down and sliding, within 3 %."""
    foot, mass = FootContact(), 1.6
    exact = exact_drop(foot, mass, speed)
    for phase in (0.1, 0.6):
        engine = DrakeEngine(drop_model(mass, TIMESTEP), TIMESTEP, rotors={})

        def step(model: mujoco.MjModel, data: mujoco.MjData, engine: DrakeEngine = engine) -> None:
            engine.step(data.qpos, data.qvel, data.xfrc_applied[1])

        shown = drop_test(foot, mass, (speed, along), TIMESTEP, phase, step)
        assert shown.peak_force == pytest.approx(exact.peak_force, rel=0.03)
        assert shown.restitution == pytest.approx(exact.restitution, rel=0.03)
        if along > exact.slowed:
            assert shown.slowed == pytest.approx(exact.slowed, rel=0.02)


def test_legs_touch_what_they_touch_in_mujoco(robot: RobotDescription) -> None:
    """Two legs in each other's way push each other off; a leg's own links do not."""
    model = build_model(robot, PlantOptions().model_options())
    model.opt.gravity[:] = 0.0
    data, engine = mujoco.MjData(model), engine_of(model, robot)
    apart = model.key("stand").qpos.copy()
    apart[2] = 3.0
    crossed = apart.copy()
    for leg, side in zip(robot.leg_names, (-1.0, 1.0, -1.0, 1.0), strict=True):
        crossed[model.joint(f"{leg}_abad").qposadr[0]] = 0.5 * side
    for position, touching in ((apart, False), (crossed, True)):
        data.qpos[:] = position
        mujoco.mj_forward(model, data)
        assert (data.ncon > 0) == touching
        moved, velocity = position.copy(), np.zeros(model.nv)
        engine.step(moved, velocity, np.zeros(model.nv))
        assert (np.abs(velocity).max() > 0.05) == touching


def test_a_standing_robot_weighs_what_it_weighs(robot: RobotDescription) -> None:
    options = on_engine(PlantOptions(), "drake")
    plant = open_plant(robot, options, TrialSettings(payload=2.0))
    plant.advance(robot.default_pose, 600)
    vertical = []
    for _ in range(100):
        plant.advance(robot.default_pose, 1)
        vertical.append(sum(plant.pads.normal_force))
    assert np.mean(vertical) == pytest.approx((robot.total_mass + 2.0) * 9.81, rel=0.03)
    assert plant.time == pytest.approx(0.7)


@pytest.mark.parametrize("name", ["sprint", "go1-sprint"])
@pytest.mark.usefixtures("brief_trials")
def test_policy_runs_in_drake(name: str) -> None:
    """Three seconds of a shipped policy, come to its speed: as in MuJoCo, in believable contact."""
    policy = load_policy(shipped_policy(name))
    robot = load_robot(policy.contract.robot_name)
    runs = [
        run_trial(policy, robot, TrialRequest(top_speed=1.0, hold=2.0, plant=plant))
        for plant in (PlantOptions(), on_engine(PlantOptions(), "drake"))
    ]
    first, second = runs
    assert not second.fall_reason, second.fall_reason
    assert second.metrics.held_speed == pytest.approx(first.metrics.held_speed, abs=0.3)
    assert second.metrics.pad_deflection < 0.015


def test_the_same_run_twice_is_the_same(robot: RobotDescription) -> None:
    plants = [
        open_plant(robot, on_engine(PlantOptions(), "drake"), TrialSettings(joint_noise=0.05)) for _ in "ab"
    ]
    for plant in plants:
        plant.advance(robot.default_pose, 100)
    np.testing.assert_array_equal(plants[0].data.qpos, plants[1].data.qpos)


def test_refused_where_drake_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sprintlab.plant.engines.find_spec", lambda _: None)
    with pytest.raises(SprintlabError, match=r"pip install 'sprintlab\[drake\]'"):
        check_engine("drake")
    check_engine("mujoco")
