from dataclasses import replace

import numpy as np
import pytest

from sprintlab.motors import copper_loss, drive_torque, electrical_power, joint_torque, saturate
from sprintlab.robots import air_drag
from sprintlab.speed_limit import evaluate
from sprintlab.speed_limit.analysis import _copper
from sprintlab.speed_limit.leg import GRAVITY, foot_position
from sprintlab.speed_limit.stride import PARAMETERS, SHAPES, STANCE_POINTS, stride_bounds

SPEED = 5.0


@pytest.fixture(scope="module")
def strides(runner):
    """Parameters of 30 strides of all kinds."""
    random = np.random.default_rng(2)
    lower, upper = stride_bounds(runner)
    parameters = random.uniform(np.maximum(lower, -0.3), np.minimum(upper, 0.9), (30, PARAMETERS))
    shapes = {"period": (0.15, 0.4), "duty": (0.08, 0.3), "sweep": (-0.05, 0.05)}
    for name, (low, high) in shapes.items():
        parameters[:, SHAPES.index(name)] = random.uniform(low, high, 30)
    reach = runner.leg.reach
    parameters[:, SHAPES.index("height")] = random.uniform(0.7 * reach, 0.85 * reach, 30)
    return parameters


def integral(stride, values):
    """Over the stance, for values at its points ``(b, STANCE_POINTS)``."""
    return np.trapezoid(values, stride.time[:, :STANCE_POINTS], axis=1)


def test_the_legs_carry_the_robot(runner, strides):
    stride = evaluate(runner, strides, SPEED)
    upward = integral(stride, stride.force[:, :STANCE_POINTS, 1])
    whole = runner.mass * GRAVITY * stride.period / runner.legs
    np.testing.assert_allclose(upward + stride.impact * whole, whole, rtol=4e-3)


@pytest.mark.parametrize("drag_area", [0.0, 0.3])
def test_the_ground_makes_up_for_the_drag_of_the_air(runner, strides, drag_area):
    runner = replace(runner, drag_area=drag_area)
    stride = evaluate(runner, strides, SPEED)
    whole = runner.mass * GRAVITY * stride.period / runner.legs
    forward = integral(stride, stride.force[:, :STANCE_POINTS, 0])
    struck = strides[:, SHAPES.index("impact_slope")] * stride.impact * whole
    drag = -air_drag(np.array([SPEED, 0.0, 0.0]), drag_area)[0]
    np.testing.assert_allclose(forward + struck, drag * stride.period / runner.legs, atol=4e-3 * whole.max())


def test_the_joints_move_on_from_stance_to_swing(runner, strides):
    stride = evaluate(runner, strides, SPEED)
    np.testing.assert_allclose(
        stride.position[:, STANCE_POINTS], stride.position[:, STANCE_POINTS - 1], atol=1e-9
    )
    np.testing.assert_allclose(stride.position[:, -1], stride.position[:, 0], atol=1e-9)
    np.testing.assert_allclose(
        stride.velocity[:, STANCE_POINTS], stride.velocity[:, STANCE_POINTS - 1], atol=1e-9
    )


def test_swing_velocity_is_the_derivative_of_its_position(runner, strides):
    stride = evaluate(runner, strides, SPEED)
    swing = slice(STANCE_POINTS, None)
    time, velocity = stride.time[:, swing, None], stride.velocity[:, swing]
    mean = 0.5 * (velocity[:, 1:] + velocity[:, :-1]) * np.diff(time, axis=1)
    np.testing.assert_allclose(mean, np.diff(stride.position[:, swing], axis=1), atol=0.02)


def test_the_trunk_passes_over_a_standing_foot(runner, strides):
    """The foot's middle goes back by the trunk's way, less what the foot rolls forward."""
    stride = evaluate(runner, strides, SPEED)
    foot = foot_position(runner.leg, stride.position)
    way = foot[:, 0, 0] - foot[:, STANCE_POINTS - 1, 0]
    turn = stride.position[:, STANCE_POINTS - 1].sum(-1) - stride.position[:, 0].sum(-1)
    inside = np.linalg.norm(foot[:, :STANCE_POINTS], axis=-1).max(axis=1) < 0.99 * runner.leg.reach
    expected = SPEED * stride.duty * stride.period - runner.leg.foot_radius * turn
    assert inside.sum() > 5
    np.testing.assert_allclose(way[inside], expected[inside], rtol=1e-3)


def test_limits_are_those_of_the_drives(runner):
    velocity = np.random.default_rng(0).normal(0.0, 20.0, (50, 2))
    lower, upper = runner.joint_limits(velocity)
    for wanted, limit in ((1e6, upper), (-1e6, lower)):
        drive = drive_torque(runner.motors, runner.gear, wanted, velocity, runner.bus_voltage)
        np.testing.assert_allclose(limit, drive.torque)


def test_copper_and_gear_loss_make_up_what_the_bus_gives_beyond_the_joints_power(runner):
    """In all quadrants: electrical power is joint power, copper loss and a gear loss, never negative."""
    random = np.random.default_rng(1)
    velocity = random.uniform(-15.0, 15.0, (400, 2))
    asked = runner.peak_torque * random.uniform(-0.7, 0.7, (400, 2)) / np.asarray(runner.gear.ratio)
    torque = joint_torque(runner.gear, saturate(runner.motors, asked), velocity)
    np.testing.assert_allclose(_copper(runner, torque, velocity), copper_loss(runner.motors, asked))
    bus = electrical_power(runner.motors, asked, velocity * np.asarray(runner.gear.ratio))
    gear_loss = bus - torque * velocity - _copper(runner, torque, velocity)
    braking = torque * velocity < 0
    assert 100 < braking.sum() < 700
    for side in (braking, ~braking):
        assert gear_loss[side].min() > -1e-9 and gear_loss[side].max() > 1.0


def test_a_stiffer_spring_follows_the_knee_more_closely(bp2):
    spring = replace(bp2.knee_spring, stiffness=1e7)
    stiff = replace(bp2, knee_spring=spring)
    parameters = np.zeros((1, PARAMETERS))
    for name, value in {"period": 0.2, "duty": 0.15, "height": 0.5, "share": 0.5}.items():
        parameters[0, SHAPES.index(name)] = value
    soft, hard = evaluate(bp2, parameters, SPEED), evaluate(stiff, parameters, SPEED)
    assert np.abs(soft.deflection).max() > 0.05
    assert np.abs(hard.deflection).max() < 1e-4
    rigid = evaluate(replace(bp2, knee_spring=None), parameters, SPEED)
    np.testing.assert_allclose(
        hard.torque[0, 2:STANCE_POINTS], rigid.torque[0, 2:STANCE_POINTS], rtol=0.02, atol=0.5
    )
