"""The Go2's table against what is published of the robot, and its motor against the published curve."""

import mujoco
import numpy as np
import pytest

from sprintlab.motors import drive_torque
from sprintlab.robots import ModelOptions, build_model, load_robot, parameter_table

FULL = ModelOptions(collisions="full", contact_time_constant=0.002)

# Unitree's curve of the actuator "Go2HV" (unitree_rl_lab): peak torque driving and braking [N m], speed up to
# which the first is had, and speed without load [rad/s]; behind the knee's further reduction of 1.917.
DRIVING, BRAKING, CORNER, NO_LOAD = 20.2, 23.4, 13.5, 30.0
REDUCTION = np.tile([1.0, 1.0, 1.917], 4)


@pytest.fixture(scope="module")
def go2():
    return load_robot("go2")


def full_torque(go2, speed, sign=1.0):
    """Torque of all drives asked for more than they have, at one speed of the hip's gear [rad/s]."""
    asked = np.full(12, sign * 1e3)
    return drive_torque(go2.motors, go2.gear, asked, speed / REDUCTION, go2.bus_voltage).torque


def test_the_model_weighs_what_is_published(go2):
    published = 6.921 + 4 * (0.678 + 1.152 + 0.241352)
    for options in (ModelOptions(), FULL):
        assert build_model(go2, options).body_mass.sum() == pytest.approx(published, abs=1e-4)


def test_the_feet_are_where_the_published_model_has_them(go2):
    """Straight legs: 0.1934 m ahead, 0.0465 and 0.0955 m aside, twice 0.213 m down."""
    model = build_model(go2)
    data = mujoco.MjData(model)
    data.qpos[:] = [0.0, 0.0, 0.0, 1.0] + [0.0] * 15
    mujoco.mj_kinematics(model, data)
    for leg, x, y in (("FL", 1, 1), ("FR", 1, -1), ("RL", -1, 1), ("RR", -1, -1)):
        np.testing.assert_allclose(data.geom(f"{leg}_foot").xpos, [0.1934 * x, 0.142 * y, -0.426], atol=1e-9)


def test_the_links_have_the_published_inertia(go2):
    """As in the URDF; its calf and foot, with the rotor, are one body in the Menagerie."""
    mechanics = go2.mechanics
    trunk = [[0.02448, 0.00012166, 0.0014849], [0.00012166, 0.098077, -3.12e-5], [0.0014849, -3.12e-5, 0.107]]
    np.testing.assert_allclose(mechanics.trunk.inertia_matrix(), trunk, atol=2e-7)
    thigh = [[0.00584, 8.72e-5, -0.000289], [8.72e-5, 0.0058, 0.000808], [-0.000289, 0.000808, 0.00103]]
    np.testing.assert_allclose(mechanics.thigh.inertia_matrix(), thigh, atol=1e-8)


def test_the_published_curve_of_the_motor_is_met(go2):
    np.testing.assert_allclose(full_torque(go2, 6.0), DRIVING * REDUCTION, rtol=0.005)
    np.testing.assert_allclose(full_torque(go2, CORNER - 0.2), DRIVING * REDUCTION, rtol=0.005)
    np.testing.assert_array_less(full_torque(go2, CORNER + 2.0), 0.95 * DRIVING * REDUCTION)
    np.testing.assert_allclose(full_torque(go2, -6.0), BRAKING * REDUCTION, rtol=0.005)
    assert np.abs(full_torque(go2, NO_LOAD)).max() < 0.02 * DRIVING


def test_what_is_unpublished_says_so():
    rows = {row.quantity: row for row in parameter_table("go2")}
    for quantity in ("pole_pairs", "q_axis_inductance", "saturation"):
        assert rows[f"motor.hip.{quantity}"].basis.startswith("unknown")
