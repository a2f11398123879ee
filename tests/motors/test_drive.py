import math

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given

from sprintlab.core.errors import InvalidValueError
from sprintlab.motors import (
    MOTOR_MODELS,
    TURNING_SPEED,
    Gear,
    PmsmParameters,
    drive_torque,
    saturate,
    torque_limits,
)

MOTORS = st.from_type(PmsmParameters)
GEARS = st.builds(Gear, ratio=st.floats(1.0, 50.0), efficiency=st.floats(0.5, 1.0))


@given(MOTORS, GEARS, st.floats(-500, 500), st.floats(-80, 80), st.sampled_from(MOTOR_MODELS))
def test_drive_clips_then_saturates_then_gears_up(motor, gear, desired, velocity, model):
    output = drive_torque(motor, gear, desired, velocity, 60.0, model)
    lower, upper = torque_limits(motor, velocity * gear.ratio, 60.0, model)
    clipped = min(max(desired / gear.ratio, lower), upper)
    assert (output.lower, output.upper) == (lower, upper)
    assert output.motor_torque == clipped
    shaft = float(saturate(motor, clipped))
    direction = math.tanh(velocity / TURNING_SPEED) * float(np.sign(shaft))
    assert output.torque == pytest.approx(gear.ratio * gear.efficiency**direction * shaft, rel=1e-12)


@pytest.mark.parametrize(
    ("field", "value"),
    [("ratio", 0.5), ("ratio", -6.0), ("ratio", math.nan), ("efficiency", 0.0), ("efficiency", 95.0)],
)
def test_impossible_gear_is_refused(field, value):
    with pytest.raises(InvalidValueError, match=field):
        Gear(**{"ratio": 6.0, "efficiency": 0.95, field: value})
