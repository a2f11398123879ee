"""A state may hold any float: it is refused by name, without a warning from the arithmetic."""

import warnings

import msgspec
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from sprintlab.deployment.controller.controller import _standing_state
from sprintlab.deployment.safety import Fault, SafetySettings
from sprintlab.deployment.safety.states import StateMonitor
from sprintlab.robots import load_robot

BP2 = load_robot("bp2")
FIELDS = ("joint_position", "joint_velocity", "joint_torque", "quaternion", "angular_velocity")


@settings(max_examples=300)
@given(st.sampled_from(FIELDS), st.integers(0, 2), st.floats())
def test_a_state_with_any_float_is_taken_or_refused(field, index, value):
    still = msgspec.structs.replace(_standing_state(BP2), sequence=1, timestamp=1)
    vector = getattr(still, field).copy()
    vector[index] = value
    monitor = StateMonitor(BP2, SafetySettings())
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        faults = monitor.accept(msgspec.structs.replace(still, **{field: vector}), 0.0)
    refused = {Fault.STATE_NOT_FINITE, Fault.STATE_IMPLAUSIBLE} & set(faults)
    assert bool(refused) is (monitor.last is None)
    if not np.isfinite(value):
        assert refused == {Fault.STATE_NOT_FINITE}
