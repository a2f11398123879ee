import numpy as np
import pytest

from sprintlab.motors import drive_torque
from sprintlab.robots import ModelOptions, load_robot

FULL = ModelOptions(collisions="full", contact_time_constant=0.002)


@pytest.fixture(scope="module")
def go1():
    return load_robot("go1")


@pytest.mark.parametrize(("joint", "torque", "speed"), [(0, 23.7, 30.1), (1, 23.7, 30.1), (2, 35.55, 20.06)])
def test_torque_and_speed_are_those_published(go1, joint, torque, speed):
    """Peak torque at a slow turn; almost nothing left at the published no-load speed."""
    velocity = np.zeros(12)
    slow = drive_torque(go1.motors, go1.gear, np.full(12, 1e3), velocity + 3.0, go1.bus_voltage)
    assert slow.torque[joint] == pytest.approx(torque, rel=0.005)
    fast = drive_torque(go1.motors, go1.gear, np.full(12, 1e3), velocity + speed, go1.bus_voltage)
    assert abs(fast.torque[joint]) < 0.02 * torque
