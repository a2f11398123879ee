import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given

from sprintlab.motors import PmsmParameters, desaturate, saturate

MOTORS = st.from_type(PmsmParameters)


@given(MOTORS, st.floats(-1.0, 1.0))
def test_desaturate_is_the_inverse(motor, share):
    torque = share * motor.peak_torque
    assert desaturate(motor, saturate(motor, torque)) == pytest.approx(torque, rel=1e-9, abs=1e-12)


@given(MOTORS)
def test_more_asked_gives_more(motor):
    output = saturate(motor, np.linspace(-motor.peak_torque, motor.peak_torque, 500))
    assert (np.diff(output) > 0).all()


@given(MOTORS, st.floats(-1.0, 1.0))
def test_saturation_is_odd_and_takes_its_share_at_the_peak(motor, share):
    torque = share * motor.peak_torque
    assert saturate(motor, -torque) == -saturate(motor, torque)
    assert saturate(motor, motor.peak_torque) == pytest.approx((1 - motor.saturation) * motor.peak_torque)


@given(MOTORS, st.floats(1.0, 10.0))
def test_unreachable_torque_asks_for_the_peak(motor, factor):
    assert desaturate(motor, factor * motor.peak_torque) == pytest.approx(motor.peak_torque)
    assert desaturate(motor, -factor * motor.peak_torque) == pytest.approx(-motor.peak_torque)
