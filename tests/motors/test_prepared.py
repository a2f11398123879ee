"""The prepared motor law is the general one."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from sprintlab.core.errors import InvalidValueError
from sprintlab.motors import (
    MOTOR_MODELS,
    PreparedDrive,
    critical_speed,
    drive_torque,
    envelope,
    prepared,
    torque_limits,
    voltage_infeasible,
)
from sprintlab.robots import load_robot

ROBOT = load_robot("bp2")
TORQUES = arrays(float, 12, elements=st.floats(-400.0, 400.0))
VELOCITIES = arrays(float, 12, elements=st.floats(-500.0, 500.0))


@pytest.mark.parametrize("model", MOTOR_MODELS)
@given(torque=TORQUES, velocity=VELOCITIES, voltage=st.floats(10.0, 100.0))
def test_equals_the_general_law_also_far_beyond_the_no_load_speed(model, torque, velocity, voltage):
    expected = drive_torque(ROBOT.motors, ROBOT.gear, torque, velocity, voltage, model)
    for got, wanted in zip(
        PreparedDrive(ROBOT.motors, ROBOT.gear, voltage, model)(torque, velocity), expected, strict=True
    ):
        np.testing.assert_allclose(np.broadcast_to(got, 12), np.broadcast_to(wanted, 12), atol=1e-9)


def test_a_model_without_a_law_raises_everywhere(monkeypatch):
    """A name that is added to the list alone gave the plant the torque of another model."""
    for module in (envelope, prepared):
        monkeypatch.setattr(module, "MOTOR_MODELS", (*MOTOR_MODELS, "cubic"))
    motors, still = ROBOT.motors, np.zeros(12)
    for ask in (
        lambda: torque_limits(motors, still, 60.0, "cubic"),
        lambda: voltage_infeasible(motors, still, 60.0, "cubic"),
        lambda: critical_speed(motors, still, 60.0, "cubic"),
        lambda: drive_torque(motors, ROBOT.gear, still, still, 60.0, "cubic"),
        lambda: PreparedDrive(motors, ROBOT.gear, 60.0, "cubic")(still, still),
    ):
        with pytest.raises(InvalidValueError, match="cubic"):
            ask()
