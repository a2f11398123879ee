"""Heat: against the differential equation, and what it does to a motor."""

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given
from scipy.integrate import solve_ivp

from sprintlab.motors import (
    HousedHeat,
    PmsmParameters,
    WindingHeat,
    copper_loss,
    flux_factor,
    heated_motor,
    no_load_speed,
    resistance_factor,
    warmed_with_housing,
)

MOTORS = st.from_type(PmsmParameters)
HOUSED = st.builds(
    HousedHeat,
    heat_capacity=st.floats(1.0, 500.0),
    thermal_resistance=st.floats(0.05, 10.0),
    housing_heat_capacity=st.floats(1.0, 2000.0),
    housing_thermal_resistance=st.floats(0.05, 10.0),
    ambient_temperature=st.floats(-20.0, 60.0),
)
TEMPERATURES = st.floats(-40.0, 200.0)


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


@given(MOTORS, TEMPERATURES)
def test_a_hot_motor_keeps_its_current_and_turns_faster(motor, temperature):
    heat = WindingHeat(reference_temperature=20.0, ambient_temperature=20.0)
    hot = heated_motor(motor, heat, temperature)
    assert hot.peak_torque / hot.torque_constant == pytest.approx(motor.peak_torque / motor.torque_constant)
    faster = no_load_speed(hot, 60.0) / no_load_speed(motor, 60.0)
    assert faster == pytest.approx(1.0 / float(flux_factor(heat, temperature)))
    more_heat = copper_loss(hot, hot.peak_torque) / copper_loss(motor, motor.peak_torque)
    assert more_heat == pytest.approx(float(resistance_factor(heat, temperature)))
