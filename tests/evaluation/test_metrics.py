"""Metrics of trajectories whose answers are known."""

import math
from dataclasses import replace

import numpy as np
import pytest

from sprintlab.evaluation.metrics import (
    GRAVITY,
    angular_cost,
    envelope_share,
    final_speed,
    peak_speed,
    slip_per_step,
    stances,
    stride_frequency,
    trial_metrics,
)
from sprintlab.motors import (
    WindingHeat,
    copper_loss,
    no_load_speed,
    resistance_factor,
    saturate,
    warmed,
)
from sprintlab.plant import PlantOptions

HOLD = (1.0, 4.0)


def test_angular_cost_integrates_roll_and_pitch_but_not_yaw(make_trajectory):
    rates = np.zeros((2000, 3))
    time = np.arange(2000) / 500.0
    rates[:, 0], rates[:, 1], rates[:, 2] = 2.0 * np.sin(2 * np.pi * time), 1.0, 100.0
    expected = (2.0 + 1.0) * time[-1]
    assert angular_cost(make_trajectory(angular_velocity=rates)) == pytest.approx(expected, rel=1e-3)


def test_peak_is_the_highest_half_second(make_trajectory):
    velocity = np.zeros((2000, 2))
    velocity[500:750, 0], velocity[1000:1010, 0] = 8.0, 50.0
    assert peak_speed(make_trajectory(velocity=velocity)) == pytest.approx(8.0)


def test_held_speed_is_the_last_two_seconds_of_the_hold(make_trajectory, robot):
    velocity = np.zeros((2500, 2))
    velocity[:1000, 0], velocity[1000:2000, 0], velocity[2000:, 0] = 3.0, 7.0, 1.0
    metrics = trial_metrics(make_trajectory(seconds=5.0, velocity=velocity), robot, HOLD)
    assert metrics.held_speed == pytest.approx(7.0)


def test_envelope_share_counts_both_limits_while_asked_to_move(make_trajectory):
    torque, command = np.zeros((2000, 12)), np.zeros((2000, 3))
    command[1000:, 0] = 5.0
    torque[:1000, 2] = 1.0  # on the limit, but standing
    torque[1000:1250, 3], torque[1500:1750, 3] = 1.0, -1.0
    share = envelope_share(make_trajectory(motor_torque=torque, command=command))
    assert share[3] == pytest.approx(0.5) and share[2] == 0.0


def test_powers_and_cost_of_transport(make_trajectory, robot):
    shape = (2000, 12)
    motor_torque, joint_velocity = np.full(shape, 2.0), np.full(shape, 3.0)
    velocity = np.tile([6.0, 0.0], (2000, 1))
    trajectory = make_trajectory(
        motor_torque=motor_torque,
        joint_velocity=joint_velocity,
        joint_torque=np.full(shape, 10.0),
        velocity=velocity,
    )
    metrics = trial_metrics(trajectory, robot, HOLD, payload=0.5)
    copper = float(copper_loss(robot.motors, np.full(12, 2.0)).sum())
    shaft = saturate(robot.motors, np.full(12, 2.0))
    electrical = float((shaft * 3.0 * robot.gear.ratio).sum()) + copper
    assert metrics.mechanical_power == pytest.approx(12 * 30.0)
    assert metrics.copper_power == pytest.approx(copper)
    assert metrics.electrical_power == pytest.approx(electrical)
    expected = electrical / ((robot.total_mass + 0.5) * GRAVITY * 6.0)
    assert metrics.cost_of_transport == pytest.approx(expected)
    ratio = 3.0 * robot.gear.ratio / no_load_speed(robot.motors, robot.bus_voltage)
    np.testing.assert_allclose(metrics.joint_speed_ratio, ratio)


@pytest.mark.parametrize(
    ("frequency", "error"), [(2.0, 2e-3), (5.0, 5e-4), (6.25, 5e-4), (6.37, 5e-4), (8.1, 5e-4)]
)
def test_stride_frequency_of_a_trot_with_its_harmonics(frequency, error):
    time = np.arange(1000) / 500.0
    phases = np.repeat([0.0, np.pi, np.pi, 0.0], 3) + np.tile([0.0, 0.3, 0.9], 4)
    angle = 2 * np.pi * frequency * time[:, None] + phases
    noise = np.random.default_rng(0).normal(scale=0.02, size=angle.shape)
    swing = 0.5 * np.cos(angle) + 0.3 * np.cos(2 * angle + 0.4) + noise
    assert stride_frequency(swing, 0.002) == pytest.approx(frequency, rel=error)


def test_a_robot_that_stands_or_shakes_has_no_stride():
    random = np.random.default_rng(0)
    assert math.isnan(stride_frequency(random.normal(scale=0.001, size=(1000, 12)), 0.002))
    assert math.isnan(stride_frequency(random.normal(scale=0.5, size=(1000, 12)), 0.002))
    assert math.isnan(stride_frequency(np.zeros((20, 12)), 0.002))


def test_a_bounce_does_not_make_a_second_stance():
    contact = np.zeros(100, dtype=bool)
    contact[10:20] = contact[23:30] = contact[60:70] = True
    assert stances(contact, shortest_flight=10).tolist() == [[10, 30], [60, 70]]
    assert stances(np.ones(5, dtype=bool), shortest_flight=10).tolist() == [[0, 5]]
    assert stances(np.zeros(5, dtype=bool), shortest_flight=10).tolist() == []


def test_slip_is_the_way_slid_in_one_stance(make_trajectory):
    contact, slip = np.zeros((2000, 4), dtype=bool), np.full((2000, 4), 0.5)
    contact[100:200, 0] = contact[500:700, 0] = True
    way = slip_per_step(make_trajectory(foot_contact=contact, foot_slip_speed=slip))
    assert way == pytest.approx(0.5 * (100 + 200) / 500.0 / 2, rel=1e-3)
    assert math.isnan(slip_per_step(make_trajectory(foot_contact=np.zeros((2000, 4), dtype=bool))))


def test_over_speed_share_is_the_time_of_all_joints_beyond_their_own_no_load_speed(make_trajectory, robot):
    limit = np.asarray(no_load_speed(robot.motors, robot.bus_voltage)) / np.asarray(robot.gear.ratio)
    velocity = np.zeros((2000, 12))
    velocity[:500, 4] = -1.01 * limit[4]
    velocity[:, 5] = 0.99 * limit[5]
    trajectory = make_trajectory(joint_velocity=velocity)
    assert trial_metrics(trajectory, robot, HOLD).over_speed_share == pytest.approx(0.25 / 12.0)
    lower_bus = PlantOptions(bus_voltage=0.9 * robot.bus_voltage)
    measured = trial_metrics(trajectory, robot, HOLD, plant=lower_bus)
    assert measured.over_speed_share == pytest.approx(1.25 / 12.0)


def test_the_rise_at_the_end_of_the_hold_is_last_second_minus_the_one_before(make_trajectory, robot):
    velocity = np.zeros((2500, 2))
    time = np.arange(2500) / 500.0
    velocity[:, 0] = 5.0 + 0.3 * time
    rising = trial_metrics(make_trajectory(seconds=5.0, velocity=velocity), robot, HOLD)
    assert rising.hold_acceleration == pytest.approx(0.3)
    short = trial_metrics(make_trajectory(seconds=5.0, velocity=velocity), robot, (3.0, 4.0))
    assert math.isnan(short.hold_acceleration)


def test_at_rest_counts_the_fastest_moment_of_the_last_second_in_any_direction(make_trajectory, robot):
    velocity = np.zeros((2000, 2))
    velocity[:1499, 0], velocity[1800] = 5.0, (0.3, -0.4)
    assert final_speed(make_trajectory(velocity=velocity)) == pytest.approx(0.5)
    assert math.isnan(trial_metrics(make_trajectory(velocity=velocity), robot, HOLD, fell=True).final_speed)


def test_gear_torque_is_compared_with_what_the_motor_can_give_at_the_joint(make_trajectory, robot):
    peak = saturate(robot.motors, robot.motors.peak_torque) * robot.gear.ratio * robot.gear.efficiency
    torque = np.zeros((2000, 12))
    torque[100, 1], torque[200, 5] = -2.0 * peak[1], 3.0 * peak[5]
    ratio = trial_metrics(make_trajectory(gear_torque=torque), robot, HOLD).gear_torque_ratio
    np.testing.assert_allclose(
        ratio, np.where(np.arange(12) == 1, 2.0, np.where(np.arange(12) == 5, 3.0, 0.0))
    )


def gait(frequency, stances):
    """Joints that swing at a frequency [Hz] and feet on the ground at these shares of a stride."""
    time = np.arange(2000) / 500.0
    phase = (time * frequency)[:, None] + np.array([0.0, 0.5, 0.5, 0.0])
    contact = np.zeros(phase.shape, dtype=bool)
    for start, end in stances:
        contact |= (phase % 1.0 >= start) & (phase % 1.0 < end)
    swing = np.sin(2 * np.pi * time * frequency)[:, None] + np.zeros(12)
    return {"foot_contact": contact, "joint_position": swing}


def test_stance_and_touchdowns_of_a_trot(make_trajectory, robot):
    metrics = trial_metrics(make_trajectory(**gait(5.0, [(0.0, 0.2)])), robot, HOLD)
    assert metrics.stance_time == pytest.approx(0.04, abs=0.0021)
    assert metrics.touchdowns_per_stride == pytest.approx(1.0, abs=0.06)
    assert metrics.mean_duty == pytest.approx(0.2, abs=0.01)


def test_the_lane_is_left_by_the_outer_edge_of_a_foot_before_the_line(make_trajectory, robot):
    feet = np.zeros((2000, 4, 3))
    feet[1000:, 3, 1] = -0.5
    feet[1600:, 3, 1] = -2.0
    metrics = trial_metrics(make_trajectory(foot_position=feet), robot, HOLD, finish=3.0)
    assert metrics.lane_excursion == pytest.approx(0.5 + robot.foot_radius)


def test_windings_at_the_line_are_heated_by_the_recorded_currents(make_trajectory, robot):
    torque = np.zeros((2000, 12))
    torque[:, 4] = 0.8 * robot.motors.peak_torque[4]
    cold = float(copper_loss(robot.motors, torque[0])[4])
    trajectory = make_trajectory(motor_torque=torque)
    metrics = trial_metrics(trajectory, robot, HOLD, finish=3.0)
    heat, temperature = WindingHeat(), 25.0
    for _ in range(3000):
        temperature = float(warmed(heat, temperature, cold * resistance_factor(heat, temperature), 0.001))
    assert metrics.line_winding_temperature == pytest.approx(temperature, abs=0.05)
    recorded = replace(trajectory, winding_temperature=np.linspace(25.0, 105.0, 2000)[:, None] + np.zeros(12))
    hot = trial_metrics(recorded, robot, HOLD, finish=2.0)
    assert hot.line_winding_temperature == pytest.approx(65.0, abs=0.1)
    assert math.isnan(trial_metrics(trajectory, robot, HOLD, finish=math.nan).line_winding_temperature)
