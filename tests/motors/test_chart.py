"""The numbers of a joint's chart, against the laws they are made of."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sprintlab.motors import (
    Gear,
    PmsmParameters,
)
from sprintlab.motors.chart import (
    JointDrive,
    d_axis_cost,
)


@given(motor=st.from_type(PmsmParameters), share=st.floats(0.05, 0.95))
def test_the_d_axis_voltage_and_the_rest_make_up_the_whole(motor, share):
    """At the refined limit |v| = V unless the current binds: v_d and v_q from the phase equations."""
    drive = JointDrive(motor=motor, gear=Gear(ratio=1.0, efficiency=1.0), bus_voltage=60.0)
    cost = d_axis_cost(drive, share)
    assert 0.0 <= cost["lost"] <= 1.0
    electrical = motor.pole_pairs * cost["speed"]
    current = cost["torque"] / motor.torque_constant
    limit = 0.95 * 60.0 / np.sqrt(3.0)
    v_q = motor.stator_resistance * current + electrical * motor.flux_linkage
    assert cost["voltage_share"] == pytest.approx(
        electrical * motor.q_axis_inductance * current / limit, abs=1e-9
    )
    if 0.0 < cost["torque"] < 0.999 * motor.peak_torque:
        assert cost["voltage_share"] ** 2 + (v_q / limit) ** 2 == pytest.approx(1.0, rel=1e-6)
