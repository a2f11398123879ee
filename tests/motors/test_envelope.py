"""The envelope against the dq equations it was derived from, and against other derivations."""

import dataclasses
import math

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


@given(MOTORS, SPEED_SHARES, BUSES, st.sampled_from(MOTOR_MODELS))
def test_negative_speed_mirrors_positive_speed(motor, share, bus, model):
    speed = share * no_load_speed(motor, bus)
    lower, upper = torque_limits(motor, speed, bus, model)
    assert torque_limits(motor, -speed, bus, model) == (-upper, -lower)
    assert -motor.peak_torque <= lower <= upper <= motor.peak_torque


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


def test_impossible_bus_voltages_are_refused(surrogate):
    for bus in (-1.0, math.nan):
        with pytest.raises(InvalidValueError, match="bus_voltage"):
            torque_limits(surrogate, 1.0, bus)
