"""The robots whose models somebody else published: what their tables say against what is published."""

import mujoco
import numpy as np
import pytest

from sprintlab.motors import drive_torque
from sprintlab.robots import ModelOptions, build_model, load_robot, parameter_table


@pytest.mark.parametrize("name", ["bp2", "go1", "go2"])
def test_every_number_says_where_it_comes_from(name):
    rows = parameter_table(name)
    assert all(row.unit and row.uncertainty and row.basis for row in rows)
    assert not any("choices" in row.basis or "import" in row.basis for row in rows)


GO2 = load_robot("go2")
# Unitree's curve of the actuator "Go2HV" (unitree_rl_lab): peak torque driving and braking [N m], speed up to
# which the first is had, and speed without load [rad/s]; behind the knee's further reduction of 1.917.
DRIVING, BRAKING, CORNER, NO_LOAD = 20.2, 23.4, 13.5, 30.0
REDUCTION = np.tile([1.0, 1.0, 1.917], 4)


def full_torque(robot, speed):
    """Torque of all drives asked for more than they have, at joint speeds [rad/s]."""
    return drive_torque(robot.motors, robot.gear, np.full(12, 1e3), speed, robot.bus_voltage).torque


def go2_torque(speed):
    """The same at a speed of the hip's gear [rad/s]."""
    return full_torque(GO2, speed / REDUCTION)


def test_the_model_weighs_what_is_published():
    published = 6.921 + 4 * (0.678 + 1.152 + 0.241352)
    for options in (ModelOptions(), ModelOptions(collisions="full")):
        assert build_model(GO2, options).body_mass.sum() == pytest.approx(published, abs=1e-4)


def test_the_feet_are_where_the_published_model_has_them():
    """Straight legs: 0.1934 m ahead, 0.0465 and 0.0955 m aside, twice 0.213 m down."""
    model = build_model(GO2)
    data = mujoco.MjData(model)
    data.qpos[:] = [0.0, 0.0, 0.0, 1.0] + [0.0] * 15
    mujoco.mj_kinematics(model, data)
    for leg, x, y in (("FL", 1, 1), ("FR", 1, -1), ("RL", -1, 1), ("RR", -1, -1)):
        np.testing.assert_allclose(data.geom(f"{leg}_foot").xpos, [0.1934 * x, 0.142 * y, -0.426], atol=1e-9)


def test_the_published_curve_of_the_motor_is_met():
    np.testing.assert_allclose(go2_torque(6.0), DRIVING * REDUCTION, rtol=0.005)
    np.testing.assert_allclose(go2_torque(CORNER - 0.2), DRIVING * REDUCTION, rtol=0.005)
    np.testing.assert_array_less(go2_torque(CORNER + 2.0), 0.95 * DRIVING * REDUCTION)
    np.testing.assert_allclose(go2_torque(-6.0), BRAKING * REDUCTION, rtol=0.005)
    assert np.abs(go2_torque(NO_LOAD)).max() < 0.02 * DRIVING


@pytest.mark.parametrize(("joint", "torque", "speed"), [(0, 23.7, 30.1), (1, 23.7, 30.1), (2, 35.55, 20.06)])
def test_torque_and_speed_of_the_go1_are_those_published(joint, torque, speed):
    """Peak torque at a slow turn; almost nothing left at the published no-load speed."""
    assert full_torque(load_robot("go1"), np.full(12, 3.0))[joint] == pytest.approx(torque, rel=0.005)
    assert abs(full_torque(load_robot("go1"), np.full(12, speed))[joint]) < 0.02 * torque
