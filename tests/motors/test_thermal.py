"""Heat: against the differential equation, and what it does to a motor."""

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import example, given
from scipy.integrate import solve_ivp

from sprintlab.core.errors import InvalidValueError
from sprintlab.motors import (
    HousedHeat,
    PmsmParameters,
    WindingHeat,
    copper_loss,
    flux_factor,
    heated_motor,
    no_load_speed,
    resistance_factor,
    torque_limits,
    warmed,
    warmed_with_housing,
)

MOTORS = st.from_type(PmsmParameters)
HEATS = st.builds(
    WindingHeat,
    heat_capacity=st.floats(1.0, 2000.0),
    thermal_resistance=st.floats(0.05, 20.0),
    ambient_temperature=st.floats(-20.0, 60.0),
    reference_temperature=st.floats(0.0, 60.0),
    magnet_share=st.floats(0.0, 1.0),
)
HOUSED = st.builds(
    HousedHeat,
    heat_capacity=st.floats(1.0, 500.0),
    thermal_resistance=st.floats(0.05, 10.0),
    housing_heat_capacity=st.floats(1.0, 2000.0),
    housing_thermal_resistance=st.floats(0.05, 10.0),
    ambient_temperature=st.floats(-20.0, 60.0),
)
TEMPERATURES = st.floats(-40.0, 200.0)


@given(HEATS, TEMPERATURES, st.floats(0.0, 2000.0))
def test_short_steps_follow_the_differential_equation(heat, temperature, loss):
    step = 1e-5 * heat.heat_capacity * heat.thermal_resistance
    rate = (loss - (temperature - heat.ambient_temperature) / heat.thermal_resistance) / heat.heat_capacity
    after = warmed(heat, temperature, loss, step)
    scale = abs(temperature - heat.ambient_temperature) + heat.thermal_resistance * loss + 1.0
    assert after - temperature == pytest.approx(step * rate, abs=2e-9 * scale)


@given(HEATS, TEMPERATURES, st.floats(0.0, 2000.0), st.integers(2, 30))
def test_many_steps_are_one_long_step(heat, temperature, loss, count):
    duration = 0.7 * heat.heat_capacity * heat.thermal_resistance
    together = warmed(heat, temperature, loss, duration)
    stepped = temperature
    for _ in range(count):
        stepped = warmed(heat, stepped, loss, duration / count)
    assert stepped == pytest.approx(together, rel=1e-9, abs=1e-6)


@given(HEATS, TEMPERATURES, st.floats(0.0, 200.0))
def test_ends_where_the_loss_flows_away(heat, temperature, loss):
    long = 60 * heat.heat_capacity * heat.thermal_resistance
    end = heat.ambient_temperature + heat.thermal_resistance * loss
    assert warmed(heat, temperature, loss, long) == pytest.approx(end, abs=1e-6)


@example(
    heat=HousedHeat(
        heat_capacity=3.0,
        thermal_resistance=5.0,
        housing_heat_capacity=1.0,
        housing_thermal_resistance=1.0,
        ambient_temperature=0.0,
    ),
    winding=0.0,
    housing=0.0,
    loss=2.3e-308,
    share=1.0,
)
@given(HOUSED, TEMPERATURES, TEMPERATURES, st.floats(0.0, 500.0), st.floats(0.01, 3.0))
def test_two_nodes_follow_scipys_integrator(heat, winding, housing, loss, share):
    def rates(_, state):
        inner = (state[0] - state[1]) / heat.thermal_resistance
        outer = (state[1] - heat.ambient_temperature) / heat.housing_thermal_resistance
        return [(loss - inner) / heat.heat_capacity, (inner - outer) / heat.housing_heat_capacity]

    duration = share * heat.thermal_resistance * heat.heat_capacity
    found = warmed_with_housing(heat, winding, housing, loss, duration)
    # Not LSODA: of losses and temperatures of some 1e-308 its steps become NaN.
    expected = solve_ivp(rates, (0.0, duration), [winding, housing], method="DOP853", rtol=1e-10, atol=1e-10)
    scale = (
        1.0 + abs(winding) + abs(housing) + loss * (heat.thermal_resistance + heat.housing_thermal_resistance)
    )
    np.testing.assert_allclose(found, expected.y[:, -1], atol=1e-7 * scale)


@given(HOUSED, TEMPERATURES, TEMPERATURES, st.floats(0.0, 500.0), st.integers(2, 20))
def test_many_steps_of_two_nodes_are_one_long_step(heat, winding, housing, loss, count):
    duration = 0.7 * heat.heat_capacity * heat.thermal_resistance
    together = warmed_with_housing(heat, winding, housing, loss, duration)
    stepped = (winding, housing)
    for _ in range(count):
        stepped = warmed_with_housing(heat, *stepped, loss, duration / count)
    np.testing.assert_allclose(stepped, together, rtol=1e-8, atol=1e-5)


@given(HOUSED, TEMPERATURES, TEMPERATURES, st.floats(0.0, 500.0))
def test_two_nodes_end_where_the_loss_flows_away(heat, winding, housing, loss):
    forever = warmed_with_housing(heat, winding, housing, loss, 1e9)
    end = heat.ambient_temperature + heat.housing_thermal_resistance * loss
    np.testing.assert_allclose(forever, (end + heat.thermal_resistance * loss, end), rtol=1e-9, atol=1e-6)


def test_a_housing_as_large_as_the_world_is_one_node():
    one = WindingHeat(heat_capacity=50.0, thermal_resistance=0.8)
    two = HousedHeat(
        heat_capacity=50.0, thermal_resistance=0.8, housing_heat_capacity=1e9, housing_thermal_resistance=0.1
    )
    winding, housing = warmed_with_housing(two, 40.0, 25.0, 60.0, 30.0)
    assert winding == pytest.approx(warmed(one, 40.0, 60.0, 30.0), abs=1e-5)
    assert housing == pytest.approx(25.0, abs=1e-5)


def test_heat_that_flows_in_is_stored_or_flows_out():
    heat = HousedHeat(
        heat_capacity=20.0,
        thermal_resistance=1.0,
        housing_heat_capacity=200.0,
        housing_thermal_resistance=2.0,
    )
    winding = housing = 25.0
    loss, step, gone = 30.0, 0.01, 0.0
    for _ in range(20000):
        before = housing
        winding, housing = warmed_with_housing(heat, winding, housing, loss, step)
        gone += step * (0.5 * (before + housing) - 25.0) / 2.0
    stored = 20.0 * (winding - 25.0) + 200.0 * (housing - 25.0)
    assert stored + gone == pytest.approx(loss * 200.0, rel=1e-6)
    assert 0.1 * loss * 200.0 < gone < 0.8 * loss * 200.0


def test_two_nodes_of_several_motors_in_numpy_and_torch(torch):
    heat = HousedHeat(
        heat_capacity=np.linspace(5.0, 50.0, 12), housing_heat_capacity=80.0, housing_thermal_resistance=1.5
    )
    winding, loss = np.linspace(20.0, 120.0, 12), np.linspace(0.0, 90.0, 12)
    expected = warmed_with_housing(heat, winding, 30.0, loss, 2.0)
    actual = warmed_with_housing(heat, torch.as_tensor(winding), 30.0, torch.as_tensor(loss), 2.0)
    np.testing.assert_allclose([value.numpy() for value in actual], expected)
    assert expected[0].shape == (12,)


@pytest.mark.parametrize("field", ["housing_heat_capacity", "housing_thermal_resistance"])
def test_an_impossible_housing_is_refused(field):
    values = {"housing_heat_capacity": 50.0, "housing_thermal_resistance": 1.0, field: 0.0}
    with pytest.raises(InvalidValueError, match=f"heat.{field}"):
        HousedHeat(**values)


def test_copper_at_100_degrees_has_31_percent_more_resistance():
    heat = WindingHeat(reference_temperature=20.0)
    assert resistance_factor(heat, 100.0) == pytest.approx(1.3144)
    assert resistance_factor(heat, np.array([20.0])) == pytest.approx(1.0)
    elsewhere = WindingHeat(reference_temperature=60.0)
    assert resistance_factor(elsewhere, 100.0) == pytest.approx(1.3144 / (1 + 0.00393 * 40))


def test_magnets_follow_half_way_and_lose_flux():
    heat = WindingHeat(magnet_share=0.5, flux_coefficient=-0.001)
    assert flux_factor(heat, 125.0) == pytest.approx(0.95)
    assert flux_factor(WindingHeat(magnet_share=0.0), 125.0) == 1.0


@given(MOTORS, TEMPERATURES)
def test_a_hot_motor_keeps_its_current_and_turns_faster(motor, temperature):
    heat = WindingHeat(reference_temperature=20.0, ambient_temperature=20.0)
    hot = heated_motor(motor, heat, temperature)
    assert hot.peak_torque / hot.torque_constant == pytest.approx(motor.peak_torque / motor.torque_constant)
    faster = no_load_speed(hot, 60.0) / no_load_speed(motor, 60.0)
    assert faster == pytest.approx(1.0 / float(flux_factor(heat, temperature)))
    more_heat = copper_loss(hot, hot.peak_torque) / copper_loss(motor, motor.peak_torque)
    assert more_heat == pytest.approx(float(resistance_factor(heat, temperature)))


def test_the_surrogate_loses_torque_when_it_is_hot(surrogate):
    hot = heated_motor(surrogate, WindingHeat(), 120.0)
    speed = 6 * 30.0
    cold_limit, hot_limit = (torque_limits(motor, speed, 60.0)[1] for motor in (surrogate, hot))
    assert 0.75 < hot_limit / cold_limit < 0.95


def test_no_temperature_gives_a_motor_that_divides_by_zero():
    heat = WindingHeat(flux_coefficient=-0.01)
    absurd = np.array([-1e4, -235.0, 1e4, 1e6])
    assert (resistance_factor(heat, absurd) > 0).all()
    assert (flux_factor(heat, absurd) > 0).all()


def test_one_motor_an_element_in_numpy_and_torch(surrogate, torch):
    heat = WindingHeat(heat_capacity=np.linspace(50, 500, 12))
    temperature, loss = np.linspace(20, 150, 12), np.linspace(0, 900, 12)
    expected = warmed(heat, temperature, loss, 1.0)
    actual = warmed(heat, torch.as_tensor(temperature), torch.as_tensor(loss), 1.0)
    np.testing.assert_allclose(actual.numpy(), expected)
    motors = heated_motor(surrogate, heat, torch.as_tensor(temperature))
    assert isinstance(motors.stator_resistance, torch.Tensor)
    assert warmed(heat, torch.zeros(12, device="meta"), 1.0, 1.0).device.type == "meta"


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("heat_capacity", 0.0),
        ("thermal_resistance", -1.0),
        ("ambient_temperature", 298.0),  # kelvin
        ("flux_coefficient", 0.001),
        ("flux_coefficient", -0.11),  # percent
        ("magnet_share", 1.5),
    ],
)
def test_impossible_heat_is_refused(field, value):
    with pytest.raises(InvalidValueError, match=f"heat.{field}"):
        WindingHeat(**{field: value})
