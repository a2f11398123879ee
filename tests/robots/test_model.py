from dataclasses import replace

import mujoco
import numpy as np
import pytest

from sprintlab.core.errors import InvalidValueError, RobotModelError
from sprintlab.motors import drive_torque
from sprintlab.robots import Link, ModelOptions, build_model, load_robot

PLANT = ModelOptions(collisions="full", contact_time_constant=0.002)


@pytest.fixture(scope="module")
def bp2():
    return load_robot("bp2")


@pytest.fixture(scope="module")
def plant(bp2):
    return build_model(bp2, PLANT)


def joint_addresses(model, names):
    """Addresses of hinge joints in ``qpos`` and ``qvel``."""
    joints = [model.joint(name) for name in names]
    return np.array([j.qposadr[0] for j in joints]), np.array([j.dofadr[0] for j in joints])


def standing(model):
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("stand").id)
    mujoco.mj_forward(model, data)
    return data


def run_standing(robot, model, seconds):
    """Hold the default pose through the motor law; returns the data and the smallest trunk height."""
    data, lowest = standing(model), np.inf
    position, velocity = joint_addresses(model, robot.joint_names)
    for _ in range(round(seconds / model.opt.timestep)):
        error = robot.default_pose - data.qpos[position]
        desired = robot.stiffness * error - robot.damping * data.qvel[velocity]
        drive = drive_torque(robot.motors, robot.gear, desired, data.qvel[velocity], robot.bus_voltage)
        data.ctrl[:] = drive.torque
        mujoco.mj_step(model, data)
        lowest = min(lowest, data.body("trunk").xpos[2])
    return data, lowest


def test_joint_properties_come_from_the_description(bp2, plant):
    _, dof = joint_addresses(plant, bp2.joint_names)
    np.testing.assert_allclose(plant.dof_armature[dof], bp2.armature)
    np.testing.assert_allclose(plant.dof_damping[dof], bp2.viscous_friction)
    np.testing.assert_allclose(plant.dof_frictionloss[dof], bp2.dry_friction)
    limits = np.array([plant.joint(name).range for name in bp2.joint_names])
    np.testing.assert_allclose(limits, bp2.position_limits)
    springs = [plant.joint(name) for name in bp2.spring_joint_names]
    assert [float(np.ravel(s.stiffness)[0]) for s in springs] == [800.0] * 4
    assert [float(np.ravel(s.damping)[0]) for s in springs] == [2.0] * 4


def test_one_leg_never_meets_itself_or_the_trunk(bp2, plant):
    data = standing(plant)
    position, _ = joint_addresses(plant, bp2.joint_names)
    random = np.random.default_rng(1)
    trunk_and_leg = {"trunk", "FL_thigh", "FL_shank", "FL_foot"}
    for _ in range(3000):
        data.qpos[2] = 5.0
        data.qpos[position[:3]] = random.uniform(*bp2.position_limits[:3].T)
        mujoco.mj_kinematics(plant, data)
        mujoco.mj_collision(plant, data)
        for contact in data.contact:
            pair = {plant.geom(int(contact.geom1)).name, plant.geom(int(contact.geom2)).name}
            assert not pair <= trunk_and_leg, (pair, data.qpos[position[:3]])


def test_legs_cannot_pass_through_each_other(bp2, plant):
    data = standing(plant)
    position, _ = joint_addresses(plant, bp2.joint_names)
    data.qpos[2] = 5.0
    data.qpos[position[[0, 3]]] = [-0.5, 0.5]
    mujoco.mj_forward(plant, data)
    pairs = {
        frozenset((plant.geom(int(c.geom1)).name[:2], plant.geom(int(c.geom2)).name[:2]))
        for c in data.contact
    }
    assert frozenset(("FL", "FR")) in pairs


COARSE = ModelOptions(timestep=0.004, contact_time_constant=0.008, knee_spring=False, dry_friction=False)


@pytest.mark.parametrize(
    ("name", "options"),
    [("bp2", PLANT), ("bp2", COARSE), ("go1", PLANT), ("go2", PLANT)],
    ids=["plant", "coarse", "go1", "go2"],
)
def test_the_robot_stands_for_two_seconds(name, options):
    robot = load_robot(name)
    model, weight = build_model(robot, options), robot.total_mass * 9.81
    data, lowest = run_standing(robot, model, 2.0)
    assert lowest > 0.9 * robot.standing_height
    assert data.body("trunk").xmat[8] > 0.99
    assert np.abs(data.qvel).max() < 0.1
    assert data.qfrc_constraint[2] == pytest.approx(weight, rel=0.01)
    touching = {
        frozenset((model.geom(int(c.geom1)).name, model.geom(int(c.geom2)).name)) for c in data.contact
    }
    assert touching == {frozenset(("floor", f"{leg}_foot")) for leg in robot.leg_names}


def test_the_knee_springs_give_way_under_the_robot(bp2, plant):
    """Deflection times stiffness is the torque that the knee motor holds."""
    data, _ = run_standing(bp2, plant, 2.0)
    spring, _ = joint_addresses(plant, bp2.spring_joint_names)
    _, knee = joint_addresses(plant, bp2.joint_names[2::3])
    torque = data.qfrc_actuator[knee]
    assert (np.abs(data.qpos[spring]) > 0.01).all()
    np.testing.assert_allclose(np.abs(800.0 * data.qpos[spring]), np.abs(torque), atol=1.5)


def test_a_contact_stiffer_than_its_steps_is_refused():
    with pytest.raises(InvalidValueError, match="at least two time steps"):
        ModelOptions(timestep=0.004, contact_time_constant=0.005)


def test_a_description_that_does_not_compile_is_one_clear_error(bp2):
    weightless = replace(bp2.mechanics, knee_carrier=Link(mass=1e-20, inertia=(1e-20,) * 3))
    with pytest.raises(RobotModelError, match=r"robot 'bp2' does not compile: .*mass and inertia"):
        build_model(replace(bp2, mechanics=weightless), ModelOptions(knee_spring=True))
