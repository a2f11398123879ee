"""Clip, saturation, gear: one after the other, and without making energy."""

import math

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given

from sprintlab.motors import (
    MOTOR_MODELS,
    TURNING_SPEED,
    Gear,
    PmsmParameters,
    copper_loss,
    desaturate,
    drive_torque,
    electrical_power,
    joint_torque,
    motor_speed,
    saturate,
    shaft_torque,
    torque_limits,
)
from sprintlab.robots import load_robot

MOTORS = st.from_type(PmsmParameters)
GEARS = st.builds(Gear, ratio=st.floats(1.0, 50.0), efficiency=st.floats(0.5, 1.0))


@given(MOTORS, GEARS, st.floats(-500, 500), st.floats(-80, 80), st.sampled_from(MOTOR_MODELS))
def test_drive_clips_then_saturates_then_gears_up(motor, gear, desired, velocity, model):
    output = drive_torque(motor, gear, desired, velocity, 60.0, model)
    lower, upper = torque_limits(motor, velocity * gear.ratio, 60.0, model)
    clipped = min(max(desired / gear.ratio, lower), upper)
    assert (output.lower, output.upper) == (lower, upper)
    assert output.motor_torque == clipped
    shaft = float(saturate(motor, clipped))
    direction = math.tanh(velocity / TURNING_SPEED) * float(np.sign(shaft))
    assert output.torque == pytest.approx(gear.ratio * gear.efficiency**direction * shaft, rel=1e-12)


@given(MOTORS, st.floats(-1.0, 1.0), st.floats(1.0, 10.0))
def test_saturation_takes_its_share_and_has_an_inverse(motor, share, factor):
    torque, peak = share * motor.peak_torque, motor.peak_torque
    assert saturate(motor, -torque) == -saturate(motor, torque)
    assert saturate(motor, peak) == pytest.approx((1 - motor.saturation) * peak)
    assert (np.diff(saturate(motor, np.linspace(-peak, peak, 500))) > 0).all()
    assert desaturate(motor, saturate(motor, torque)) == pytest.approx(torque, rel=1e-9, abs=1e-12)
    assert desaturate(motor, -factor * peak) == pytest.approx(-peak)


def test_electrical_input_is_joint_output_and_heat_in_all_four_quadrants():
    robot, ones = load_robot("bp2"), np.ones(12)
    at = np.meshgrid([-90.0, -30.0, -2.0, 2.0, 30.0, 90.0], [-30.0, -6.0, -0.3, -0.01, 0.01, 0.3, 6.0, 30.0])
    desired, velocity = (each.reshape(-1, 1) * ones for each in at)
    drive = drive_torque(robot.motors, robot.gear, desired, velocity, robot.bus_voltage)
    speed = motor_speed(robot.gear, velocity)
    electrical = electrical_power(robot.motors, drive.motor_torque, speed)
    gear_loss = saturate(robot.motors, drive.motor_torque) * speed - drive.torque * velocity
    copper = copper_loss(robot.motors, drive.motor_torque)
    np.testing.assert_allclose(electrical, drive.torque * velocity + copper + gear_loss, atol=1e-9)
    assert (gear_loss >= -1e-12).all() and (copper >= 0.0).all()


def test_the_gear_passes_all_on_at_rest_and_turns_smoothly():
    gear = Gear(ratio=6.0, efficiency=0.9)
    velocity = np.linspace(-5.0, 5.0, 20001)
    torque = joint_torque(gear, np.full_like(velocity, 3.0), velocity)
    assert torque[10000] == pytest.approx(18.0)
    assert torque[-1] == pytest.approx(18.0 * 0.9, rel=1e-3)
    assert torque[0] == pytest.approx(18.0 / 0.9, rel=1e-3)
    assert np.abs(np.diff(torque)).max() < 0.002
    np.testing.assert_allclose(shaft_torque(gear, torque, velocity), 3.0)
