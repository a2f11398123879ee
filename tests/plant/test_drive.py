"""The prepared motor law is the general one."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from sprintlab.core.errors import InvalidValueError
from sprintlab.motors import MOTOR_MODELS, drive_torque, no_load_speed
from sprintlab.plant import PreparedDrive
from sprintlab.robots import load_robot

ROBOT = load_robot("bp2")
TORQUES = arrays(float, 12, elements=st.floats(-400.0, 400.0))
VELOCITIES = arrays(float, 12, elements=st.floats(-500.0, 500.0))


@pytest.mark.parametrize("model", MOTOR_MODELS)
@given(torque=TORQUES, velocity=VELOCITIES, voltage=st.floats(10.0, 100.0))
def test_equals_the_general_law_also_far_beyond_the_no_load_speed(model, torque, velocity, voltage):
    expected = drive_torque(ROBOT.motors, ROBOT.gear, torque, velocity, voltage, model)
    for got, wanted in zip(PreparedDrive(ROBOT, voltage, model)(torque, velocity), expected, strict=True):
        np.testing.assert_allclose(np.broadcast_to(got, 12), np.broadcast_to(wanted, 12), atol=1e-9)


def test_equals_the_general_law_around_the_speed_where_no_current_fits():
    no_load = no_load_speed(ROBOT.motors, 60.0) / ROBOT.gear.ratio
    for share in np.linspace(0.9, 4.0, 4001):
        lower, upper = PreparedDrive(ROBOT, 60.0).limits(share * no_load)
        expected = drive_torque(ROBOT.motors, ROBOT.gear, np.zeros(12), share * no_load, 60.0)
        np.testing.assert_allclose(lower, expected.lower, atol=1e-6)
        np.testing.assert_allclose(upper, expected.upper, atol=1e-6)


def test_refuses_a_voltage_of_zero_and_an_unknown_model():
    with pytest.raises(InvalidValueError, match="bus_voltage"):
        PreparedDrive(ROBOT, 0.0)
    with pytest.raises(InvalidValueError, match="square"):
        PreparedDrive(ROBOT, 60.0, "cubic")
