"""I²t: against the differential equation and its closed form, and what it does to a drive."""

import math
from dataclasses import replace

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given

from sprintlab.core.errors import InvalidValueError
from sprintlab.motors import (
    MOTOR_MODELS,
    Gear,
    I2tLimit,
    PmsmParameters,
    drive_torque,
    i2t_current,
    i2t_decay,
    i2t_drive,
    i2t_level,
    i2t_time_constant,
    squared_current,
)

MOTORS = st.from_type(PmsmParameters)
GEAR = Gear(ratio=6.0, efficiency=0.9)


def peak_current(motor):
    return motor.peak_torque / motor.torque_constant


def step(level, decay, current, continuous=10.0):
    """One step in which the drive wants a current: what flows, and the level after it."""
    flowing = min(current, float(i2t_current(continuous, level, decay)))
    return flowing, float(i2t_level(continuous, level, flowing**2, decay))


def test_the_peak_current_flows_for_its_duration_and_then_the_continuous_one(surrogate):
    continuous = 0.5 * peak_current(surrogate)
    limit = I2tLimit(continuous_current=continuous, peak_duration=3.0)
    decay, level, currents = i2t_decay(limit, surrogate, 0.001), 0.0, []
    for _ in range(6000):
        flowing, level = step(level, decay, peak_current(surrogate), continuous)
        currents.append(flowing)
        assert level <= 1.0
    peak = peak_current(surrogate)
    assert np.allclose(currents[:3000], peak, rtol=1e-9)
    assert np.allclose(currents[3001:], continuous, rtol=1e-9)


@pytest.mark.parametrize("model", MOTOR_MODELS)
@given(
    motor=MOTORS,
    level=st.floats(0.0, 1.0),
    share=st.floats(0.1, 0.95),
    wanted=st.floats(-1.5, 1.5),
    speed=st.floats(-300.0, 300.0),
)
def test_it_is_the_motor_law_with_a_lower_current_limit(model, motor, level, share, wanted, speed):
    continuous, velocity = share * peak_current(motor), speed / GEAR.ratio
    decay = math.exp(-0.3)
    desired = wanted * motor.peak_torque * GEAR.ratio
    output, after = i2t_drive(motor, GEAR, continuous, level, decay, desired, velocity, 60.0, model)
    allowed = min(peak_current(motor), float(i2t_current(continuous, level, decay)))
    cut = allowed / peak_current(motor)
    weaker = replace(motor, peak_torque=motor.peak_torque * cut, saturation=motor.saturation * cut)
    expected = drive_torque(weaker, GEAR, desired, velocity, 60.0, model)
    for got, right in zip(output, expected, strict=True):
        np.testing.assert_allclose(got, right, rtol=1e-9, atol=1e-9)
    assert squared_current(motor, output) <= allowed**2 * (1.0 + 1e-6)
    assert 0.0 <= after <= 1.0


def test_a_limit_that_does_not_fit_the_motor_is_refused(surrogate):
    limit = I2tLimit(continuous_current=1.01 * peak_current(surrogate), time_constant=1.0)
    with pytest.raises(InvalidValueError, match="must lie below the peak current of 78"):
        i2t_time_constant(limit, surrogate)
