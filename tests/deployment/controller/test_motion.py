"""Motions without a policy begin and end where they should, without a jump."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sprintlab.deployment.controller.legs import Legs, folded_pose, tucked_pose
from sprintlab.deployment.controller.motion import (
    rise_motion,
    settle_motion,
    sink_motion,
)
from sprintlab.robots import ModelOptions, build_model, load_robot

BP2, WAIST = load_robot("bp2"), load_robot("bp2-waist")
A, B = BP2.mechanics.thigh_length, BP2.mechanics.shank_length


def feet(pose):
    """Position of each foot from its hip, in the plane of the leg: x forward, z up ``(4, 2)``."""
    _, hip, knee = np.asarray(pose).reshape(4, 3).T
    x = -(A * np.sin(hip) + B * np.sin(hip + knee))
    z = -(A * np.cos(hip) + B * np.cos(hip + knee))
    return np.stack((x, z), axis=1)


@pytest.mark.parametrize("robot", [BP2, load_robot("go1")], ids=lambda robot: robot.name)
def test_the_folded_and_the_tucked_pose_are_low_and_have_room_at_the_stops(robot):
    lower, upper = robot.position_limits.T
    for pose in (folded_pose(robot), tucked_pose(robot)):
        assert (pose > lower + robot.soft_stop.zone).all() and (pose < upper - robot.soft_stop.zone).all()
    assert feet(folded_pose(BP2))[:, 0] == pytest.approx(np.zeros(4), abs=1e-12)  # below the hips
    depth = -Legs(robot).feet(tucked_pose(robot))[:, 2]
    assert (depth < 0.2 * robot.standing_height).all()
    for pose in (folded_pose, tucked_pose):
        np.testing.assert_array_equal(pose(WAIST), [*pose(BP2), 0.0])


@given(st.lists(st.floats(-0.05, 0.05), min_size=12, max_size=12))
def test_a_pose_is_taken_over_without_a_jump(offset):
    start = BP2.default_pose + np.array(offset)
    motion = settle_motion(BP2, start, 2.0)
    path = np.array([motion.target(time) for time in np.arange(2.0, 2.5, 0.005)])
    np.testing.assert_allclose(path[0], start, atol=1e-12)
    legs = Legs(BP2)
    loads = legs.loads(legs.feet(BP2.default_pose))
    carried = BP2.default_pose + legs.carrying_torque(BP2.default_pose, loads) / BP2.stiffness
    np.testing.assert_allclose(path[-1], carried, atol=1e-9)
    assert np.abs(np.diff(path, axis=0)).max() < 0.005


@given(st.lists(st.tuples(st.floats(-0.3, 0.3), st.floats(0.35, 1.0)), min_size=4, max_size=4))
def test_sinking_keeps_every_foot_where_it_stands(angles):
    start = np.array([(abad, hip, -1.2 - 0.5 * (hip - 0.7)) for abad, hip in angles]).reshape(-1)
    legs, motion = Legs(BP2), sink_motion(BP2, start, 1.0)
    np.testing.assert_allclose(motion.target(1.0), start, atol=1e-9)
    for time in np.linspace(1.0, 2.0, 5):  # until the knees are folded
        now = legs.feet(motion._pose(time)[0])
        np.testing.assert_allclose(now[:, :2], legs.feet(start)[:, :2], atol=1e-6)
    assert motion.end_time == 3.5
    np.testing.assert_allclose(motion.target(3.5), tucked_pose(BP2), atol=1e-6)


ROBOTS = [load_robot("bp2"), load_robot("go1")]
POSES = st.lists(
    st.tuples(st.floats(-0.4, 0.4), st.floats(0.5, 1.1), st.floats(-1.9, -1.0)), min_size=4, max_size=4
).map(lambda legs: np.array(legs).reshape(-1))


def placed(robot, pose):
    """The model of a robot in a pose, at rest, and its feet from the trunk (4, 3) [m]."""
    model = build_model(robot, ModelOptions())
    data = mujoco.MjData(model)
    for joint, angle in zip(robot.joint_names, pose, strict=True):
        data.joint(joint).qpos[0] = angle
    mujoco.mj_forward(model, data)
    feet = np.array([data.geom(f"{leg}_foot").xpos for leg in robot.leg_names])
    return model, data, feet - data.body("trunk").xpos


@pytest.mark.parametrize("robot", [BP2, WAIST], ids=lambda robot: robot.name)
def test_feet_are_where_the_simulated_robot_has_them(robot):
    pose = robot.default_pose + 0.1 * np.sin(np.arange(float(len(robot.joint_names))))
    *_, seen = placed(robot, pose)
    np.testing.assert_allclose(Legs(robot).feet(pose), seen, atol=1e-9)


@given(pose=POSES)
def test_the_torques_that_carry_do_the_work_of_the_loads(pose):
    """Virtual work: torque times a small motion is the load times the way that the foot is pushed down."""
    legs, loads = Legs(BP2), np.array([10.0, 20.0, 30.0, 40.0])
    torque = legs.carrying_torque(pose, loads)
    for joint in range(12):
        small = np.zeros(12)
        small[joint] = 1e-6
        rise = (legs.feet(pose + small) - legs.feet(pose - small))[:, 2] / 2e-6
        assert torque[joint] == pytest.approx(-(loads * rise).sum(), abs=1e-5)


def test_the_loads_carry_the_weight_in_balance_where_the_feet_allow_it():
    legs = Legs(BP2)
    feet_below = legs.feet(BP2.default_pose)
    loads = legs.loads(feet_below)
    assert loads.sum() == pytest.approx(9.81 * BP2.total_mass) and (loads > 0.0).all()
    assert loads @ feet_below[:, :2] == pytest.approx(np.zeros(2), abs=1e-9)


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: robot.name)
@given(pose=POSES)
def test_rising_begins_at_the_joints_and_moves_all_legs_alike(robot, pose):
    legs, motion = Legs(robot), rise_motion(robot, pose, 2.0)
    np.testing.assert_allclose(motion.target(2.0), pose, atol=1e-9)
    assert motion.end_time == 4.5
    np.testing.assert_allclose(motion._pose(4.5)[0], robot.default_pose, atol=1e-6)
    hips = legs.feet(folded_pose(robot))
    hips[:, 2] = 0.0
    for time in np.linspace(3.0, 3.75, 6):  # until the feet are below the hips
        below = legs.feet(motion._pose(time)[0]) - hips
        np.testing.assert_allclose(below, np.tile(below[0], (4, 1)), atol=1e-9)
