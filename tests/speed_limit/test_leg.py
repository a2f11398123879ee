import mujoco
import numpy as np
import pytest

from sprintlab.robots import ModelOptions, load_robot, robot_spec
from sprintlab.speed_limit.leg import (
    contact_jacobian,
    foot_jacobian,
    foot_position,
    inverse_dynamics,
    joint_position,
    mass_matrix,
    planar_leg,
    stance_motion,
)


@pytest.fixture(scope="module", params=["bp2", "go1"])
def robot(request):
    return load_robot(request.param)


@pytest.fixture(scope="module")
def held(robot):
    """The robot's own model with its trunk held and nothing but inertia and gravity."""
    spec = robot_spec(robot, ModelOptions(dry_friction=False, joint_limits=False, knee_spring=False))
    spec.delete(spec.joint("root"))
    spec.delete(spec.keys[0])
    model = spec.compile()
    model.dof_damping[:] = 0.0
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    return model


def test_inverse_dynamics_is_that_of_the_compiled_model(robot, held):
    leg, random = planar_leg(robot), np.random.default_rng(0)
    data = mujoco.MjData(held)
    for _ in range(20):
        position, velocity, acceleration = (
            random.uniform(*robot.position_limits[1:3].T),
            random.normal(0.0, 20.0, 2),
            random.normal(0.0, 500.0, 2),
        )
        data.qpos[1:3], data.qvel[1:3], data.qacc[1:3] = position, velocity, acceleration
        mujoco.mj_inverse(held, data)
        torque = inverse_dynamics(leg, position, velocity, acceleration)
        np.testing.assert_allclose(torque, data.qfrc_inverse[1:3], rtol=1e-6, atol=1e-7)


def test_the_foot_is_where_the_model_has_it(robot, held):
    leg, data = planar_leg(robot), mujoco.MjData(held)
    data.qpos[1:3] = robot.default_pose[1:3]
    mujoco.mj_kinematics(held, data)
    from_hip = data.geom("FL_foot").xpos - data.body("FL_thigh").xpos
    np.testing.assert_allclose(foot_position(leg, robot.default_pose[1:3]), from_hip[[0, 2]], atol=1e-12)


def test_joint_position_inverts_foot_position(robot):
    leg, random = planar_leg(robot), np.random.default_rng(1)
    position = random.uniform([-0.6, -2.5], [2.0, -0.3], (200, 2))
    np.testing.assert_allclose(joint_position(leg, foot_position(leg, position)), position, atol=1e-9)


def test_jacobian_is_the_derivative(robot):
    leg, position, step = planar_leg(robot), np.array([0.4, -1.1]), 1e-6
    columns = [
        (foot_position(leg, position + step * unit) - foot_position(leg, position - step * unit)) / (2 * step)
        for unit in np.eye(2)
    ]
    np.testing.assert_allclose(foot_jacobian(leg, position), np.array(columns).T, atol=1e-8)


def test_a_standing_foot_rolls_and_does_not_slip(robot):
    """The hip moves at its speed over the contact point, whose foot turns: the middle moves by r omega."""
    leg, position = planar_leg(robot), np.array([0.4, -1.1])
    hip = np.array([7.0, -0.4])
    velocity, _ = stance_motion(leg, position, hip, np.zeros(2))
    middle = hip + foot_jacobian(leg, position) @ velocity
    np.testing.assert_allclose(middle, [leg.foot_radius * velocity.sum(), 0.0], atol=1e-12)


def test_stance_acceleration_is_the_derivative_of_the_velocity(robot):
    leg, position, step = planar_leg(robot), np.array([0.4, -1.1]), 1e-6
    hip, lift = np.array([7.0, -0.4]), np.array([0.0, 25.0])
    velocity, acceleration = stance_motion(leg, position, hip, lift)
    later, _ = stance_motion(leg, position + step * velocity, hip + step * lift, lift)
    np.testing.assert_allclose((later - velocity) / step, acceleration, rtol=1e-3)


def test_mass_matrix_gives_the_kinetic_energy_of_the_contact(robot):
    leg, position = planar_leg(robot), np.array([0.4, -1.1])
    matrix = mass_matrix(leg, position)
    np.testing.assert_allclose(matrix, matrix.T, atol=1e-12)
    assert np.linalg.eigvalsh(matrix).min() > 0.0
    np.testing.assert_array_equal(
        contact_jacobian(leg, position)[1], foot_jacobian(leg, position)[1]
    )  # the contact point lies straight below: only forward motion differs
