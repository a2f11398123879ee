"""Flux weakening against a brute-force search over the current plane, and against its own limits."""

import dataclasses
import math

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import assume, given

from sprintlab.motors import (
    PmsmParameters,
    copper_loss,
    critical_speed,
    dq_currents,
    electrical_power,
    no_load_speed,
    phase_voltage_limit,
    torque_limits,
    voltage_infeasible,
)

MODEL = "flux-weakening"
MOTORS = st.from_type(PmsmParameters)
BUSES = st.floats(15.0, 100.0)
SPEED_SHARES = st.floats(-4.0, 4.0)  # of the no-load speed


def voltages(motor, direct, quadrature, speed):
    """v_d and v_q in the steady state, written down afresh."""
    electrical, inductance = motor.pole_pairs * speed, motor.q_axis_inductance
    resistance = motor.stator_resistance
    return (
        resistance * direct - electrical * inductance * quadrature,
        resistance * quadrature + electrical * (inductance * direct + motor.flux_linkage),
    )


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


def test_over_speed_allows_no_drive_and_is_reported(surrogate):
    # psi > L I: the current disk never reaches the centre of the voltage disk.
    fastest = float(critical_speed(surrogate, 0.0, 60.0, MODEL))
    assert fastest > 3 * no_load_speed(surrogate, 60.0)
    assert not voltage_infeasible(surrogate, 0.99 * fastest, 60.0, MODEL)
    beyond = 1.5 * fastest
    assert voltage_infeasible(surrogate, beyond, 60.0, MODEL)
    lower, upper = torque_limits(surrogate, beyond, 60.0, MODEL)
    assert lower < 0.0 == upper
    stronger = dataclasses.replace(surrogate, peak_torque=20.0)  # 104 A, above psi / L = 90 A
    assert critical_speed(stronger, 0.0, 60.0, MODEL) == math.inf
    assert not voltage_infeasible(stronger, 1e6, 60.0, MODEL)
    assert math.isfinite(critical_speed(stronger, 0.1, 60.0, MODEL))
