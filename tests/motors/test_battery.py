"""The battery: its own circuit, and the joints that share it."""

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given

from sprintlab.motors import (
    Battery,
    battery_current,
    discharged,
    loaded_voltage,
    open_circuit_voltage,
    shared_bus_voltage,
)

BATTERIES = st.builds(
    Battery,
    series_cells=st.integers(6, 24),
    internal_resistance=st.floats(0.0, 0.2),
    regeneration_limit=st.floats(0.0, 100.0),
)
CHARGES = st.floats(0.0, 1.0)


def test_open_circuit_voltage_follows_the_table_and_ends_with_it():
    battery = Battery(charge_table=(0.0, 0.5, 1.0), voltage_table=(3.0, 3.6, 4.2), series_cells=10)
    charge = np.array([-1.0, 0.0, 0.25, 0.5, 0.75, 1.0, 2.0])
    expected = [30.0, 30.0, 33.0, 36.0, 39.0, 42.0, 42.0]
    np.testing.assert_allclose(open_circuit_voltage(battery, charge), expected)


@given(BATTERIES, CHARGES, st.floats(-0.2, 1.0))
def test_a_load_takes_out_what_the_source_gives_less_the_loss_inside(battery, charge, share):
    source = float(open_circuit_voltage(battery, charge))
    resistance = battery.internal_resistance
    most = source**2 / (4 * max(resistance, 1e-3))
    power = share * most
    voltage = float(loaded_voltage(battery, charge, power))
    current = float(battery_current(battery, voltage, power))
    assert 0.5 * source - 1e-9 <= voltage <= source + resistance * battery.regeneration_limit + 1e-9
    assert current >= -battery.regeneration_limit
    if current > -battery.regeneration_limit and resistance > 0:
        assert source - voltage == pytest.approx(resistance * current, abs=1e-6 * source)


def solved(battery, charge, power_at, voltage):
    """Whether the residual is small, or changes sign within 0.1 mV: where a motor's power leaps."""

    def residual(bus):
        return bus - loaded_voltage(battery, charge, power_at(bus))

    tolerance = 1e-4 + 1e-12 * voltage
    around = (residual(voltage - tolerance) <= 0) & (residual(voltage + tolerance) >= 0)
    return around | (np.abs(residual(voltage)) <= tolerance)


@given(charge=st.floats(-0.1, 1.1), stiffness=st.floats(0.0, 400.0), power=st.floats(-8000.0, 8000.0))
def test_numbers_and_arrays_give_the_same_voltage_to_the_last_bit(charge, stiffness, power):
    """Numbers are computed without NumPy: the plant asks for one voltage a millisecond."""
    battery = Battery()

    def power_at(bus):
        return power + stiffness * (bus - 50.0)

    for guess in (None, 44.0):
        alone = shared_bus_voltage(battery, charge, power_at, guess)
        [among_others] = shared_bus_voltage(battery, np.array([charge]), power_at, guess)
        assert alone == among_others
    [left] = discharged(battery, np.array([charge]), power, 0.001)
    assert discharged(battery, charge, power, 0.001) == left


@given(
    cells=st.integers(1, 500),
    resistance=st.floats(0.0, 10.0),
    limit=st.floats(0.0, 1e5),
    seed=st.integers(0, 2**32 - 1),
)
def test_every_battery_finds_its_voltage_whatever_the_power_does(torch, cells, resistance, limit, seed):
    battery = Battery(series_cells=cells, internal_resistance=resistance, regeneration_limit=limit)
    random = np.random.default_rng(seed)
    charge = random.uniform(0.0, 1.0, 20)
    source = open_circuit_voltage(battery, charge)
    most = source**2 / (4 * max(resistance, 1e-3))
    scale, leap = random.uniform(-3.0, 3.0, (2, 20)) * most
    power, place = random.uniform(-2.0, 8.0, 20), random.uniform(0.5, 1.1, 20)

    def power_at(bus):
        return scale * (bus / source) ** power + np.where(bus > place * source, leap, 0.0)

    alone = shared_bus_voltage(battery, charge, power_at)  # NumPy stops by itself, tensors take fixed steps
    together = shared_bus_voltage(
        battery, torch.as_tensor(charge), lambda bus: torch.as_tensor(power_at(bus.numpy()))
    )
    assert solved(battery, charge, power_at, alone).all()
    assert solved(battery, charge, power_at, together.numpy()).all()


def test_charge_runs_out_with_the_current_and_stays_within_its_ends():
    battery = Battery(capacity=1.0)
    assert discharged(battery, 0.5, 1.0, 360.0) == pytest.approx(0.4)
    assert discharged(battery, 0.5, -1.0, 360.0) == pytest.approx(0.6)
    assert discharged(battery, 0.01, 100.0, 360.0) == 0.0
    assert discharged(battery, 0.99, -100.0, 360.0) == 1.0
