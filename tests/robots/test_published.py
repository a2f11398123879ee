"""What holds of every robot whose model somebody else published."""

from pathlib import Path

import numpy as np
import pytest

from sprintlab import robots
from sprintlab.motors import drive_torque
from sprintlab.robots import load_robot, parameter_table

published = pytest.mark.parametrize("name", ["go1", "go2"])


@published
def test_every_number_says_where_it_comes_from(name):
    rows = parameter_table(name)
    assert all(row.unit and row.uncertainty and row.basis for row in rows)
    assert not any("choices" in row.basis or "import" in row.basis for row in rows)


@published
def test_the_license_of_the_model_is_there(name):
    text = (Path(robots.__file__).parent / name / "LICENSE").read_text(encoding="utf-8")
    assert "BSD 3-Clause License" in text
    assert "Unitree Robotics" in text


@pytest.mark.parametrize(("joint", "torque", "speed"), [(0, 23.7, 30.1), (1, 23.7, 30.1), (2, 35.55, 20.06)])
def test_torque_and_speed_of_the_go1_are_those_published(joint, torque, speed):
    """Peak torque at a slow turn; almost nothing left at the published no-load speed."""
    go1, velocity = load_robot("go1"), np.zeros(12)
    slow = drive_torque(go1.motors, go1.gear, np.full(12, 1e3), velocity + 3.0, go1.bus_voltage)
    assert slow.torque[joint] == pytest.approx(torque, rel=0.005)
    fast = drive_torque(go1.motors, go1.gear, np.full(12, 1e3), velocity + speed, go1.bus_voltage)
    assert abs(fast.torque[joint]) < 0.02 * torque
