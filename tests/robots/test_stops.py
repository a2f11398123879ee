import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sprintlab.robots import SoftStop, soft_stop_torque

STOP = SoftStop(zone=0.1, stiffness=500.0, damping=5.0)
LIMITS = np.array([[-1.0, 2.0]])


def torque(position: float, velocity: float) -> float:
    return float(soft_stop_torque(np.array([position]), np.array([velocity]), LIMITS, STOP)[0])


@given(position=st.floats(-2.0, 3.0), velocity=st.floats(-50.0, 50.0))
def test_a_stop_never_pulls_and_both_stops_mirror_each_other(position, velocity):
    value, depth = torque(position, velocity), position - 1.9
    if position >= 0.5:
        assert value == pytest.approx(-max(500.0 * depth + 5.0 * velocity, 0.0) if depth > 0.0 else 0.0)
    assert value >= 0.0 if position < 0.5 else value <= 0.0
    assert torque(1.0 - position, -velocity) == pytest.approx(-value, abs=1e-9)
