"""Flux weakening against a brute-force search over the current plane, and against its own limits."""

import dataclasses
import math

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import assume, given

from sprintlab.core.errors import InvalidValueError
from sprintlab.motors import (
    PmsmParameters,
    copper_loss,
    critical_speed,
    dq_currents,
    drive_torque,
    electrical_power,
    mtpv_currents,
    no_load_speed,
    phase_voltage_limit,
    torque_limits,
    voltage_infeasible,
    weakening_current,
)
from sprintlab.motors.gear import Gear

MODEL = "flux-weakening"
MOTORS = st.from_type(PmsmParameters)
BUSES = st.floats(15.0, 100.0)
SPEED_SHARES = st.floats(-4.0, 4.0)  # of the no-load speed


def current_limit(motor):
    return motor.peak_torque / motor.torque_constant


def voltages(motor, direct, quadrature, speed):
    """v_d and v_q in the steady state, written down afresh."""
    electrical, inductance = motor.pole_pairs * speed, motor.q_axis_inductance
    resistance = motor.stator_resistance
    return (
        resistance * direct - electrical * inductance * quadrature,
        resistance * quadrature + electrical * (inductance * direct + motor.flux_linkage),
    )


def brute_force(motor, speed, bus, rings=200, spokes=721):
    """Least and greatest i_q of a polar grid over the current disk that the voltage allows."""
    radius = np.sqrt(np.linspace(0.0, 1.0, rings))[:, None] * current_limit(motor)
    angle = np.linspace(0.0, 2 * math.pi, spokes)
    direct, quadrature = radius * np.cos(angle), radius * np.sin(angle)
    allowed = np.hypot(*voltages(motor, direct, quadrature, speed)) <= phase_voltage_limit(bus)
    return (quadrature[allowed].min(), quadrature[allowed].max()) if allowed.any() else None


@given(MOTORS, SPEED_SHARES, BUSES)
def test_limits_are_the_ends_of_a_brute_force_search(motor, share, bus):
    speed = share * float(no_load_speed(motor, bus))
    found = brute_force(motor, speed, bus)
    if found is None:
        return
    lower, upper = (bound / motor.torque_constant for bound in torque_limits(motor, speed, bus, MODEL))
    limit = current_limit(motor)
    assert lower <= found[0] + 1e-9 * limit
    assert upper >= found[1] - 1e-9 * limit
    # A sliver that two disks share may fall between the grid's points.
    radius = phase_voltage_limit(bus) / math.hypot(
        motor.stator_resistance, motor.pole_pairs * speed * motor.q_axis_inductance
    )
    if radius > 0.2 * limit and upper - lower > 0.2 * limit:
        assert found == pytest.approx((lower, upper), abs=0.03 * limit)


@given(MOTORS, SPEED_SHARES, BUSES, st.sampled_from([0, 1]))
def test_the_current_at_a_bound_keeps_both_limits_and_touches_one(motor, share, bus, end):
    speed = share * float(no_load_speed(motor, bus))
    assume(not voltage_infeasible(motor, speed, bus, MODEL))
    bound = torque_limits(motor, speed, bus, MODEL)[end]
    direct, quadrature = dq_currents(motor, bound, speed, bus)
    used_voltage = np.hypot(*voltages(motor, direct, quadrature, speed)) / phase_voltage_limit(bus)
    used_current = math.hypot(direct, quadrature) / current_limit(motor)
    assert used_voltage <= 1 + 1e-6
    assert used_current <= 1 + 1e-9
    assert max(used_voltage, used_current) == pytest.approx(1.0, rel=1e-6)


@given(MOTORS, SPEED_SHARES, BUSES, st.floats(-1.0, 1.0))
def test_no_smaller_current_gives_the_torque(motor, share, bus, torque_share):
    speed = share * float(no_load_speed(motor, bus))
    assume(not voltage_infeasible(motor, speed, bus, MODEL))
    lower, upper = torque_limits(motor, speed, bus, MODEL)
    torque = np.clip(torque_share * motor.peak_torque, lower, upper)
    direct, quadrature = dq_currents(motor, torque, speed, bus)
    assert motor.torque_constant * quadrature == pytest.approx(torque, abs=1e-12 * motor.peak_torque)
    assert direct <= 0.0
    smaller = direct * np.linspace(0.0, 0.999, 50)
    used = np.hypot(*voltages(motor, smaller, quadrature, speed))
    assert (used[smaller > direct] >= phase_voltage_limit(bus) * (1 - 1e-9)).all()


@given(MOTORS, SPEED_SHARES, BUSES)
def test_allows_all_that_the_refined_model_allows(motor, share, bus):
    speed = share * float(no_load_speed(motor, bus))
    assume(not voltage_infeasible(motor, speed, bus))
    inner, outer = (torque_limits(motor, speed, bus, model) for model in ("refined", MODEL))
    assert outer[0] <= inner[0] + 1e-9 * motor.peak_torque
    assert outer[1] >= inner[1] - 1e-9 * motor.peak_torque


@given(MOTORS, st.floats(0.0, 1.0), BUSES)
def test_equals_the_refined_model_up_to_its_critical_speed(motor, share, bus):
    speed = share * float(critical_speed(motor, motor.peak_torque, bus))
    weakened, refined = (torque_limits(motor, speed, bus, model)[1] for model in (MODEL, "refined"))
    assert weakened == pytest.approx(refined, rel=1e-9)
    assert weakening_current(motor, 0.999 * motor.peak_torque, 0.999 * speed, bus) == 0.0


@given(MOTORS, st.floats(0.0, 4.0), BUSES)
def test_backward_is_the_mirror_of_forward(motor, share, bus):
    speed = share * float(no_load_speed(motor, bus))
    lower, upper = torque_limits(motor, speed, bus, MODEL)
    assert torque_limits(motor, -speed, bus, MODEL) == (-upper, -lower)


@given(MOTORS, SPEED_SHARES, BUSES)
def test_without_inductance_no_current_weakens_the_field(motor, share, bus):
    motor = dataclasses.replace(motor, q_axis_inductance=0.0)
    speed = share * float(no_load_speed(motor, bus))
    assume(not voltage_infeasible(motor, speed, bus))
    np.testing.assert_allclose(
        torque_limits(motor, speed, bus, MODEL),
        torque_limits(motor, speed, bus, "simplified-dc"),
        atol=1e-6 * motor.peak_torque,
    )


@given(MOTORS, st.floats(-1.0, 1.0), BUSES)
def test_a_torque_fits_just_below_its_critical_speed_and_not_above(motor, share, bus):
    assume(motor.stator_resistance * current_limit(motor) < phase_voltage_limit(bus))
    torque = share * motor.peak_torque
    speed = float(critical_speed(motor, torque, bus, MODEL))
    assume(0.0 < speed < 100 * no_load_speed(motor, bus))

    def fits(at):
        lower, upper = torque_limits(motor, at, bus, MODEL)
        slack = 1e-9 * motor.peak_torque
        inside = lower - slack <= torque <= upper + slack
        return bool(inside and not voltage_infeasible(motor, at, bus, MODEL))

    assert fits(0.999 * speed)
    assert not fits(1.001 * speed)


@given(MOTORS, st.floats(-1.0, 1.0), BUSES)
def test_the_critical_speed_is_not_below_the_refined_one(motor, share, bus):
    torque = share * motor.peak_torque
    refined = critical_speed(motor, torque, bus)
    assert critical_speed(motor, torque, bus, MODEL) >= refined * (1 - 1e-9)


@given(MOTORS, st.floats(-4.0, 4.0), BUSES, st.floats(-1.0, 1.0))
def test_terminal_power_is_mechanical_power_plus_copper_loss(motor, share, bus, torque_share):
    speed = share * float(no_load_speed(motor, bus))
    direct, quadrature = dq_currents(motor, torque_share * motor.peak_torque, speed, bus)
    torque = motor.torque_constant * quadrature
    direct_voltage, quadrature_voltage = voltages(motor, direct, quadrature, speed)
    terminal = 1.5 * (direct_voltage * direct + quadrature_voltage * quadrature)
    scale = 1.5 * (abs(direct_voltage * direct) + abs(quadrature_voltage * quadrature)) + 1e-12
    linear = dataclasses.replace(motor, saturation=0.0)
    assert electrical_power(linear, torque, speed, direct) == pytest.approx(terminal, abs=1e-9 * scale)
    loss = 1.5 * motor.stator_resistance * (direct**2 + quadrature**2)
    assert copper_loss(motor, torque, direct) == pytest.approx(loss, rel=1e-9, abs=1e-12)


@given(MOTORS, BUSES, st.floats(0.2, 0.8))
def test_at_very_high_speed_the_drive_follows_mtpv_where_the_current_reaches_it(motor, bus, reach):
    inductance = motor.flux_linkage / (reach * current_limit(motor))  # psi / L lies within the current disk
    resistance = min(motor.stator_resistance, 0.2 * phase_voltage_limit(bus) / current_limit(motor))
    assume(inductance < min(1e-2, 0.05 * resistance))
    motor = dataclasses.replace(motor, q_axis_inductance=inductance, stator_resistance=resistance)
    # Fast enough that the resistance no longer decides where the centre of the voltage disk lies.
    speed = 300 * resistance / (inductance * motor.pole_pairs)
    speed = max(speed, 20 * float(no_load_speed(motor, bus)))
    top = mtpv_currents(motor, speed, bus)
    assert top.direct == pytest.approx(-motor.flux_linkage / inductance, rel=1e-4)
    assert torque_limits(motor, speed, bus, MODEL)[1] == pytest.approx(
        motor.torque_constant * top.quadrature, rel=1e-9
    )
    used = np.hypot(*voltages(motor, top.direct, top.quadrature, speed))
    assert used == pytest.approx(phase_voltage_limit(bus), rel=1e-6)


def test_surrogate_gains_torque_at_high_speed(surrogate):
    joint_torque = 6 * torque_limits(surrogate, 6 * 35.0, 60.0, MODEL)[1]
    assert joint_torque == pytest.approx(76.0, abs=1.0)  # 42 without flux weakening
    output = drive_torque(surrogate, Gear(ratio=6.0, efficiency=1.0), 500.0, 35.0, 60.0, MODEL)
    assert output.motor_torque == output.upper
    assert output.direct_current < -30.0


def test_over_speed_allows_no_drive_and_is_reported(surrogate):
    # psi > L I: the current disk never reaches the centre of the voltage disk.
    fastest = float(critical_speed(surrogate, 0.0, 60.0, MODEL))
    assert fastest > 3 * no_load_speed(surrogate, 60.0)
    assert not voltage_infeasible(surrogate, 0.99 * fastest, 60.0, MODEL)
    beyond = 1.5 * fastest
    assert voltage_infeasible(surrogate, beyond, 60.0, MODEL)
    lower, upper = torque_limits(surrogate, beyond, 60.0, MODEL)
    assert lower < 0.0 == upper


def test_no_torque_has_no_end_of_speed_where_the_current_cancels_the_magnets(surrogate):
    stronger = dataclasses.replace(surrogate, peak_torque=20.0)  # 104 A, above psi / L = 90 A
    assert critical_speed(stronger, 0.0, 60.0, MODEL) == math.inf
    assert not voltage_infeasible(stronger, 1e6, 60.0, MODEL)
    assert math.isfinite(critical_speed(stronger, 0.1, 60.0, MODEL))


def test_square_model_is_never_infeasible_and_an_unknown_one_is_refused(surrogate):
    assert not voltage_infeasible(surrogate, 1e4, 60.0, "square")
    with pytest.raises(InvalidValueError, match="model = 'linear'"):
        voltage_infeasible(surrogate, 1.0, 60.0, "linear")
    with pytest.raises(InvalidValueError, match="bus_voltage"):
        dq_currents(surrogate, 1.0, 1.0, -60.0)
