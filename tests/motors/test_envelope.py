"""The envelope against the dq equations it was derived from, and against other derivations."""

import dataclasses
import math
import time

import hypothesis.strategies as st
import mujoco
import numpy as np
import pytest
from hypothesis import assume, given

from sprintlab.core.errors import InvalidValueError
from sprintlab.motors import (
    MOTOR_MODELS,
    PmsmParameters,
    critical_speed,
    no_load_speed,
    phase_voltage_limit,
    prepared_torque_limits,
    torque_limits,
    voltage_infeasible,
)

MOTORS = st.from_type(PmsmParameters)
BUSES = st.floats(15.0, 100.0)
SPEED_SHARES = st.floats(-2.5, 2.5)  # of the no-load speed: all four quadrants and far beyond


def phase_voltage(motor, torque, speed, model="refined"):
    """The dq equations with i_d = 0, written down afresh."""
    current = torque / (1.5 * motor.pole_pairs * motor.flux_linkage)
    electrical_speed = motor.pole_pairs * speed
    direct = -electrical_speed * motor.q_axis_inductance * current
    quadrature = motor.stator_resistance * current + electrical_speed * motor.flux_linkage
    return np.hypot(direct if model == "refined" else 0.0, quadrature)


@given(MOTORS, st.lists(SPEED_SHARES, min_size=1, max_size=5), st.floats(0.0, 100.0))
def test_prepared_limits_are_the_same_to_the_last_bit(motor, shares, bus):
    speed = np.array(shares) * float(no_load_speed(motor, 48.0))
    for got, expected in zip(
        prepared_torque_limits(motor)(speed, bus), torque_limits(motor, speed, bus), strict=True
    ):
        np.testing.assert_array_equal(got, expected)


@given(MOTORS, SPEED_SHARES, BUSES, st.sampled_from(["refined", "simplified-dc"]))
def test_limits_separate_admissible_torques_from_the_others(motor, share, bus, model):
    speed = share * no_load_speed(motor, bus)
    voltage = phase_voltage_limit(bus)
    torques = np.linspace(-motor.peak_torque, motor.peak_torque, 2001)
    lower, upper = torque_limits(motor, speed, bus, model)
    admissible = phase_voltage(motor, torques, speed, model) <= voltage
    margin = 1e-6 * motor.peak_torque
    if not admissible.any():
        return
    inside = (torques > lower + margin) & (torques < upper - margin)
    outside = (torques < lower - margin) | (torques > upper + margin)
    assert admissible[inside].all()
    assert not admissible[outside].any()


@given(MOTORS, SPEED_SHARES, BUSES)
def test_a_bound_below_the_peak_lies_on_the_voltage_circle(motor, share, bus):
    speed = share * no_load_speed(motor, bus)
    assume(not voltage_infeasible(motor, speed, bus))
    for bound in torque_limits(motor, speed, bus):
        used = phase_voltage(motor, bound, speed) / phase_voltage_limit(bus)
        if abs(bound) < motor.peak_torque * (1 - 1e-9):
            assert used == pytest.approx(1.0, rel=1e-6)
        else:
            assert used <= 1.0 + 1e-6


@given(MOTORS, st.floats(-6.0, 6.0), BUSES)
def test_over_speed_mask_is_true_exactly_where_no_torque_is_admissible(motor, share, bus):
    speed = share * no_load_speed(motor, bus)
    voltage = phase_voltage_limit(bus)
    current_peak = motor.peak_torque / motor.torque_constant
    reactance = motor.pole_pairs * speed * motor.q_axis_inductance
    back_emf = motor.pole_pairs * speed * motor.flux_linkage
    best = -motor.stator_resistance * back_emf / (motor.stator_resistance**2 + reactance**2)
    best = np.clip(best, -current_peak, current_peak)
    least = phase_voltage(motor, best * motor.torque_constant, speed)
    assume(abs(least / voltage - 1.0) > 1e-9)
    assert bool(voltage_infeasible(motor, speed, bus)) == (least > voltage)


@given(MOTORS, st.floats(1.0, 20.0), BUSES)
def test_over_speed_leaves_no_drive_and_the_least_violating_brake(motor, share, bus):
    speed = share * no_load_speed(motor, bus)
    torques = np.linspace(-motor.peak_torque, motor.peak_torque, 4001)
    impedance = math.hypot(motor.stator_resistance, motor.pole_pairs * speed * motor.q_axis_inductance)
    reactive_emf = (motor.pole_pairs * speed) ** 2 * motor.q_axis_inductance * motor.flux_linkage
    assume(impedance * phase_voltage_limit(bus) < reactive_emf)
    lower, upper = torque_limits(motor, speed, bus)
    assert voltage_infeasible(motor, speed, bus)
    assert lower == upper
    assert upper <= 0.0
    assert phase_voltage(motor, lower, speed) <= phase_voltage(motor, torques, speed).min() * (1 + 1e-12)


def test_over_speed_continues_the_interval_without_a_jump(surrogate):
    """Up to where no current fits and beyond: the forced brake never jumps, and never drives."""
    speed = np.linspace(0.9, 2.5, 400_001) * float(no_load_speed(surrogate, 60.0))
    lower, upper = torque_limits(surrogate, speed, 60.0)
    assert voltage_infeasible(surrogate, speed[-1], 60.0)
    assert not voltage_infeasible(surrogate, speed[0], 60.0)
    assert np.abs(np.diff(upper)).max() < 0.05
    assert np.abs(np.diff(lower)).max() < 0.05
    assert (upper[speed > float(no_load_speed(surrogate, 60.0)) * (1 + 1e-9)] < 0.0).all()


@given(MOTORS, st.floats(-50.0, 50.0), st.floats(0.0, 100.0), st.sampled_from(MOTOR_MODELS))
def test_limits_are_finite_ordered_and_within_the_peak_at_any_speed(motor, share, bus, model):
    lower, upper = torque_limits(motor, share * no_load_speed(motor, 60.0), bus, model)
    assert -motor.peak_torque <= lower <= upper <= motor.peak_torque


@given(MOTORS, SPEED_SHARES, BUSES, st.sampled_from(MOTOR_MODELS))
def test_negative_speed_mirrors_positive_speed(motor, share, bus, model):
    speed = share * no_load_speed(motor, bus)
    lower, upper = torque_limits(motor, speed, bus, model)
    mirrored_lower, mirrored_upper = torque_limits(motor, -speed, bus, model)
    assert mirrored_lower == -upper
    assert mirrored_upper == -lower


@given(MOTORS, BUSES, st.sampled_from(MOTOR_MODELS))
def test_driving_torque_never_grows_with_speed(motor, bus, model):
    speeds = np.linspace(0.0, float(no_load_speed(motor, bus)), 200)
    _, upper = torque_limits(motor, speeds, bus, model)
    assert (np.diff(upper) <= 1e-9 * motor.peak_torque).all()


@given(MOTORS, st.floats(0.0, 1.0), BUSES)
def test_driving_torque_never_falls_with_the_bus_voltage(motor, share, bus):
    speed = share * no_load_speed(motor, bus)
    _, upper = torque_limits(motor, speed, np.linspace(bus, 2 * bus, 50))
    assert (np.diff(upper) >= -1e-9 * motor.peak_torque).all()


@given(MOTORS, st.floats(0.0, 1.0), BUSES)
def test_each_model_allows_no_less_drive_than_the_more_faithful_one(motor, share, bus):
    speed = share * no_load_speed(motor, bus)
    refined, simplified, square, weakened = (
        torque_limits(motor, speed, bus, model)[1] for model in MOTOR_MODELS
    )
    assert refined <= weakened + 1e-9 * motor.peak_torque
    assert weakened <= square
    assert refined <= simplified + 1e-9 * motor.peak_torque
    assert simplified <= square == motor.peak_torque


@given(MOTORS, st.floats(0.0, 1.0), BUSES)
def test_braking_has_at_least_the_torque_of_driving(motor, share, bus):
    lower, upper = torque_limits(motor, share * no_load_speed(motor, bus), bus)
    assert -lower >= upper - 1e-9 * motor.peak_torque


@given(MOTORS, SPEED_SHARES, BUSES)
def test_refined_without_inductance_is_the_simplified_model(motor, share, bus):
    speed = share * no_load_speed(motor, bus)
    without = dataclasses.replace(motor, q_axis_inductance=0.0)
    refined, simplified = (torque_limits(without, speed, bus, m) for m in ("refined", "simplified-dc"))
    assert refined == simplified
    torque = 0.5 * motor.peak_torque
    assert critical_speed(without, torque, bus) == critical_speed(motor, torque, bus, "simplified-dc")


@given(MOTORS, st.floats(0.0, 1.2), BUSES)
def test_small_inductance_tends_to_the_simplified_model(motor, share, bus):
    speed = share * no_load_speed(motor, bus)
    tiny = dataclasses.replace(motor, q_axis_inductance=1e-12)
    np.testing.assert_allclose(
        torque_limits(tiny, speed, bus),
        torque_limits(motor, speed, bus, "simplified-dc"),
        atol=1e-6 * motor.peak_torque,
    )


@given(MOTORS, st.floats(0.01, 1.0), BUSES, st.sampled_from(["refined", "simplified-dc"]))
def test_critical_speed_lies_on_the_circle(motor, share, bus, model):
    torque = share * motor.peak_torque
    speed = critical_speed(motor, torque, bus, model)
    used = phase_voltage(motor, torque, speed, model) / phase_voltage_limit(bus)
    if speed > 0:
        assert used == pytest.approx(1.0, rel=1e-9)
    else:
        assert used >= 1.0 - 1e-9


@given(MOTORS, st.floats(0.01, 1.0), BUSES)
def test_critical_speed_equals_bisection(motor, share, bus):
    torque, voltage = share * motor.peak_torque, phase_voltage_limit(bus)
    assume(phase_voltage(motor, torque, 0.0) < voltage)
    low, high = 0.0, float(no_load_speed(motor, bus))
    for _ in range(80):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if phase_voltage(motor, torque, middle) <= voltage else (low, middle)
    assert critical_speed(motor, torque, bus) == pytest.approx(low, rel=1e-9, abs=1e-9)


@given(MOTORS, BUSES)
def test_critical_speed_is_the_papers_closed_form(motor, bus):
    resistance, inductance, flux = motor.stator_resistance, motor.q_axis_inductance, motor.flux_linkage
    torque, pole_pairs = motor.peak_torque, motor.pole_pairs
    a = 4 / (9 * flux**2) * inductance**2 * torque**2 + pole_pairs**2 * flux**2
    b = 4 / 3 * resistance * torque
    c = 4 * torque**2 * resistance**2 / (9 * pole_pairs**2 * flux**2) - phase_voltage_limit(bus) ** 2
    assume(c < 0)
    assert critical_speed(motor, torque, bus) == pytest.approx(
        (-b + math.sqrt(b * b - 4 * a * c)) / (2 * a), rel=1e-6
    )


@given(MOTORS, st.floats(0.05, 0.999), BUSES)
def test_critical_speed_and_limits_are_inverse(motor, share, bus):
    torque = share * motor.peak_torque
    speed = critical_speed(motor, torque, bus)
    assume(speed > 0)
    assert torque_limits(motor, speed, bus)[1] == pytest.approx(torque, rel=1e-6)


def test_braking_torque_fits_beyond_the_no_load_speed(surrogate):
    assert critical_speed(surrogate, -5.0, 60.0) > no_load_speed(surrogate, 60.0)


def test_torque_that_fits_at_no_speed_has_critical_speed_zero(surrogate):
    assert critical_speed(surrogate, 1e3, 60.0) == 0.0
    assert critical_speed(surrogate, -1e3, 60.0) == 0.0


def test_square_model_knows_no_critical_speed(surrogate):
    assert critical_speed(surrogate, 15.0, 60.0, "square") == math.inf


def test_surrogate_has_the_published_corner_speeds(surrogate):
    corners = [critical_speed(surrogate, 15.0, 60.0, model) / 6 for model in ("simplified-dc", "refined")]
    assert no_load_speed(surrogate, 60.0) / 6 == pytest.approx(43.0, abs=0.05)
    assert corners == pytest.approx([31.1, 25.2], abs=0.06)


def test_surrogate_has_the_published_torques(surrogate):
    speeds = 6 * np.array([25.0, 30.0, 35.0])
    assert 6 * torque_limits(surrogate, speeds, 60.0)[1] == pytest.approx([90, 65, 42], abs=0.5)
    assert 6 * torque_limits(surrogate, speeds, 60.0, "simplified-dc")[1] == pytest.approx(
        [90, 90, 60], abs=0.5
    )
    assert 6 * torque_limits(surrogate, 6 * 40.0, 60.0)[0] == pytest.approx(-82, abs=0.5)


def mujoco_dc_motor(motor):
    """The motor as MuJoCo's own, after the power-invariant transformation: K = sqrt(3/2) N psi, same R."""
    constant = math.sqrt(1.5) * motor.pole_pairs * motor.flux_linkage
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco><worldbody><body><joint name="shaft"/><geom size=".1"/></body></worldbody>
        <actuator><dcmotor joint="shaft" motorconst="{constant!r} {constant!r}"
        resistance="{motor.stator_resistance!r}"/></actuator></mujoco>"""
    )


@given(MOTORS, SPEED_SHARES, BUSES)
def test_envelope_without_inductance_is_mujocos_dc_motor_at_full_voltage(motor, share, bus):
    motor = dataclasses.replace(motor, q_axis_inductance=0.0)
    model = mujoco_dc_motor(motor)
    data = mujoco.MjData(model)
    speed = share * float(no_load_speed(motor, bus))
    for sign, bound in zip((-1.0, 1.0), torque_limits(motor, speed, bus), strict=True):
        data.ctrl[0] = sign * math.sqrt(1.5) * phase_voltage_limit(bus)
        data.qvel[0] = speed
        mujoco.mj_forward(model, data)
        expected = np.clip(data.actuator_force[0], -motor.peak_torque, motor.peak_torque)
        assert bound == pytest.approx(expected, rel=1e-9, abs=1e-9 * motor.peak_torque)


def test_a_million_points_take_less_than_half_a_second_of_one_core(surrogate):
    speeds = np.random.default_rng(0).uniform(-500.0, 500.0, 1_000_000)
    best = math.inf
    for _ in range(3):
        started = time.process_time()
        torque_limits(surrogate, speeds, 60.0)
        best = min(best, time.process_time() - started)
    assert best < 0.5


@pytest.mark.parametrize("call", [torque_limits, lambda m, s, b, model: critical_speed(m, 1.0, b, model)])
def test_unknown_model_is_refused(surrogate, call):
    with pytest.raises(InvalidValueError, match=r"model = 'linear' .* choose one of refined, simplified-dc"):
        call(surrogate, 1.0, 60.0, "linear")


@pytest.mark.parametrize("bus", [-1.0, math.nan, math.inf])
def test_impossible_bus_voltage_is_refused(surrogate, bus):
    with pytest.raises(InvalidValueError, match="bus_voltage"):
        torque_limits(surrogate, 1.0, bus)


def test_impossible_voltage_utilization_is_refused():
    with pytest.raises(InvalidValueError, match="utilization"):
        phase_voltage_limit(60.0, 1.5)
