import dataclasses

import hypothesis.strategies as st
import pytest
from hypothesis import given

from sprintlab.motors import PmsmParameters, copper_loss, electrical_power, no_load_speed, saturate

MOTORS = st.from_type(PmsmParameters)


@given(MOTORS, st.floats(-1.0, 1.0), st.floats(-1.5, 1.5))
def test_terminal_power_is_mechanical_power_plus_copper_loss(motor, torque_share, speed_share):
    torque = torque_share * motor.peak_torque
    speed = speed_share * float(no_load_speed(motor, 60.0))
    current = torque / (1.5 * motor.pole_pairs * motor.flux_linkage)
    voltage = motor.stator_resistance * current + motor.pole_pairs * speed * motor.flux_linkage
    terminal = 1.5 * voltage * current  # v_d meets i_d = 0
    scale = abs(torque * speed) + copper_loss(motor, torque) + 1e-12
    unsaturated = dataclasses.replace(motor, saturation=0.0)
    assert electrical_power(unsaturated, torque, speed) == pytest.approx(terminal, abs=1e-9 * scale)
    assert torque * speed + copper_loss(motor, torque) == pytest.approx(terminal, abs=1e-9 * scale)
    shaft = saturate(motor, torque) * speed
    assert electrical_power(motor, torque, speed) == pytest.approx(
        shaft + copper_loss(motor, torque), abs=1e-9 * scale
    )
