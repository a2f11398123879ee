"""Three thousand motors from all corners of what is possible, against bisection of the dq equations."""

import dataclasses

import numpy as np
import pytest

from sprintlab.motors import (
    MOTOR_MODELS,
    PmsmParameters,
    critical_speed,
    no_load_speed,
    phase_voltage_limit,
    torque_limits,
    voltage_infeasible,
)

COUNT = 3000
LIMITED = [model for model in MOTOR_MODELS if model != "square"]


def spread(random, low, high, count):
    """Evenly in the exponent."""
    return np.exp(random.uniform(np.log(low), np.log(high), count))


@pytest.fixture(scope="module")
def corners():
    """Motors, speeds up to 50 times no-load, standstill and exactly no-load among them, and buses."""
    random = np.random.default_rng(20261121)
    drawn = 20 * COUNT
    pairs = random.integers(1, 60, drawn).astype(float)
    resistance, flux = spread(random, 1e-4, 50.0, drawn), spread(random, 1e-5, 0.5, drawn)
    inductance = spread(random, 1e-8, 1e-2, drawn) * (random.random(drawn) > 0.03)
    current = spread(random, 0.05, 5e3, drawn)
    torque = 1.5 * pairs * flux * current
    possible = (inductance / resistance < 0.05) & (current * resistance < 500.0) & (torque < 5e3)
    chosen = np.flatnonzero(possible & (torque > 1e-4))[:COUNT]
    motor = PmsmParameters(
        pole_pairs=pairs[chosen],
        stator_resistance=resistance[chosen],
        q_axis_inductance=inductance[chosen],
        flux_linkage=flux[chosen],
        peak_torque=torque[chosen],
        saturation=random.uniform(0.0, 0.49, COUNT),
        rotor_inertia=np.full(COUNT, 1e-4),
    )
    bus = spread(random, 5.0, 800.0, COUNT)
    share = spread(random, 1e-3, 50.0, COUNT)
    share[:100], share[100:200] = 0.0, 1.0
    return motor, share * random.choice([-1.0, 1.0], COUNT) * no_load_speed(motor, bus), bus


def spare_voltage(motor, quadrature, speed, bus, model):
    """What the inverter has left at the most favourable i_d, negative where it does not suffice [V]."""
    electrical = motor.pole_pairs * speed
    inductance = 0.0 if model == "simplified-dc" else motor.q_axis_inductance
    direct = np.zeros_like(quadrature)
    if model == "flux-weakening":
        limit = motor.peak_torque / motor.torque_constant
        within = np.sqrt(np.maximum(limit**2 - quadrature**2, 0.0))
        nearest = electrical**2 * inductance * motor.flux_linkage
        squared = motor.stator_resistance**2 + (electrical * inductance) ** 2
        direct = np.clip(-nearest / squared, -within, within)
    v_d = motor.stator_resistance * direct - electrical * inductance * quadrature
    v_q = motor.stator_resistance * quadrature + electrical * (inductance * direct + motor.flux_linkage)
    return phase_voltage_limit(bus) - np.hypot(v_d, v_q)


def bisected_limits(motor, speed, bus, model):
    """Ends of the admissible i_q, and whether there is any: the spare voltage is concave in i_q."""
    limit = motor.peak_torque / motor.torque_constant
    low, high = -limit, limit
    for _ in range(120):
        step = 0.6180339887498949 * (high - low)
        left, right = high - step, low + step
        upward = spare_voltage(motor, right, speed, bus, model) >= spare_voltage(
            motor, left, speed, bus, model
        )
        low, high = np.where(upward, left, low), np.where(upward, high, right)
    best = 0.5 * (low + high)
    for end in (-limit, limit):
        better = spare_voltage(motor, end, speed, bus, model) > spare_voltage(motor, best, speed, bus, model)
        best = np.where(better, end, best)
    ends = []
    for end in (-limit, limit):
        inside, outside = best, end
        for _ in range(100):
            middle = 0.5 * (inside + outside)
            fits = spare_voltage(motor, middle, speed, bus, model) >= 0.0
            inside, outside = np.where(fits, middle, inside), np.where(fits, outside, middle)
        ends.append(np.where(spare_voltage(motor, end, speed, bus, model) >= 0.0, end, inside))
    return ends[0], ends[1], spare_voltage(motor, best, speed, bus, model)


@pytest.mark.parametrize("model", LIMITED)
def test_limits_are_those_of_bisection(corners, model):
    motor, speed, bus = corners
    lower, upper = torque_limits(motor, speed, bus, model)
    least, most, spare = bisected_limits(motor, speed, bus, model)
    clear = np.abs(spare) > 1e-9 * phase_voltage_limit(bus)
    infeasible = voltage_infeasible(motor, speed, bus, model)
    np.testing.assert_array_equal(infeasible[clear], (spare < 0.0)[clear])
    fits = ~infeasible & (spare >= 0.0)
    assert fits.sum() > 1500
    for found, expected in ((lower, least), (upper, most)):
        error = np.abs(found / motor.torque_constant - expected) * motor.torque_constant / motor.peak_torque
        assert error[fits].max() < 1e-8


@pytest.mark.parametrize("share", [1.0, 0.5, 0.0, -0.5])
@pytest.mark.parametrize("model", LIMITED)
def test_no_torque_fits_beyond_its_critical_speed(corners, model, share):
    """Also torques that brake, which may fit in a window of speeds alone."""
    motor, _, bus = corners
    critical = critical_speed(motor, share * motor.peak_torque, bus, model)
    current = share * motor.peak_torque / motor.torque_constant
    volts = phase_voltage_limit(bus)
    ends = np.isfinite(critical) & (critical > 0.0)
    with np.errstate(invalid="ignore"):
        below = spare_voltage(motor, current, critical * (1.0 - 1e-7), bus, model) / volts
    assert below[ends].min() > -1e-9
    farther = np.maximum(critical, 1e-4 * no_load_speed(motor, bus))
    for factor in np.geomspace(1.0 + 1e-6, 1e4, 200):
        beyond = spare_voltage(
            motor, current, np.where(np.isfinite(farther), farther, 0.0) * factor, bus, model
        )
        assert (beyond / volts)[np.isfinite(critical)].max() < 1e-9


@pytest.mark.parametrize("model", MOTOR_MODELS)
def test_single_precision_stays_finite_and_ordered(corners, model, torch):
    motor, speed, bus = corners
    columns = {field.name: getattr(motor, field.name) for field in dataclasses.fields(motor)}
    single = PmsmParameters(**{name: torch.as_tensor(value).float() for name, value in columns.items()})
    lower, upper = torque_limits(
        single, torch.tensor(speed, dtype=torch.float32), torch.tensor(bus, dtype=torch.float32), model
    )
    assert torch.isfinite(lower).all()
    assert torch.isfinite(upper).all()
    assert (lower <= upper).all()
