"""Energy in all four quadrants: what goes in comes out or becomes heat, in every form of the law."""

import numpy as np
import pytest

from sprintlab.motors import (
    Gear,
    copper_loss,
    drive_torque,
    electrical_power,
    joint_torque,
    motor_speed,
    saturate,
    shaft_torque,
)
from sprintlab.robots import load_robot

VELOCITY = np.array([-30.0, -6.0, -0.3, -0.01, 0.01, 0.3, 6.0, 30.0])
TORQUE = np.array([-90.0, -30.0, -2.0, 2.0, 30.0, 90.0])


@pytest.fixture(scope="module")
def robot():
    return load_robot("bp2")


@pytest.fixture(scope="module")
def points(robot):
    """Every torque at every speed, the same on all twelve joints ``(n, 12)``."""
    torque, velocity = np.meshgrid(TORQUE, VELOCITY)
    ones = np.ones(len(robot.joint_names))
    return torque.reshape(-1, 1) * ones, velocity.reshape(-1, 1) * ones


def test_electrical_input_is_joint_output_and_heat(robot, points):
    desired, velocity = points
    drive = drive_torque(robot.motors, robot.gear, desired, velocity, robot.bus_voltage)
    speed = motor_speed(robot.gear, velocity)
    electrical = electrical_power(robot.motors, drive.motor_torque, speed)
    gear_loss = saturate(robot.motors, drive.motor_torque) * speed - drive.torque * velocity
    copper = copper_loss(robot.motors, drive.motor_torque)
    np.testing.assert_allclose(electrical, drive.torque * velocity + copper + gear_loss, atol=1e-9)
    assert (gear_loss >= -1e-12).all()
    assert (copper >= 0.0).all()
    assert (electrical - drive.torque * velocity >= -1e-12).all(), "a drive that makes energy"


def test_the_gear_passes_all_on_at_rest_and_turns_smoothly():
    gear = Gear(ratio=6.0, efficiency=0.9)
    velocity = np.linspace(-5.0, 5.0, 20001)
    torque = joint_torque(gear, np.full_like(velocity, 3.0), velocity)
    assert torque[10000] == pytest.approx(18.0)
    assert torque[-1] == pytest.approx(18.0 * 0.9, rel=1e-3)
    assert torque[0] == pytest.approx(18.0 / 0.9, rel=1e-3)
    assert np.abs(np.diff(torque)).max() < 0.002
    np.testing.assert_allclose(shaft_torque(gear, torque, velocity), 3.0)
