"""What holds of every robot whose model somebody else published."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from sprintlab import robots
from sprintlab.control import pd_torque
from sprintlab.motors import drive_torque
from sprintlab.robots import ModelOptions, build_model, load_robot, parameter_table

published = pytest.mark.parametrize("name", ["go1", "go2"])


@published
def test_it_stands_on_its_feet_for_two_seconds(name):
    robot = load_robot(name)
    model = build_model(robot, ModelOptions(collisions="full", contact_time_constant=0.002))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    position = [model.joint(joint).qposadr[0] for joint in robot.joint_names]
    velocity = [model.joint(joint).dofadr[0] for joint in robot.joint_names]
    for _ in range(2000):
        angle, speed = data.qpos[position], data.qvel[velocity]
        desired = pd_torque(robot.stiffness, robot.damping, robot.default_pose, angle, speed)
        data.ctrl[:] = drive_torque(robot.motors, robot.gear, desired, speed, robot.bus_voltage).torque
        mujoco.mj_step(model, data)
    assert data.body("trunk").xpos[2] > 0.9 * robot.standing_height
    assert data.body("trunk").xmat[8] > 0.99
    assert np.abs(data.qvel).max() < 0.1
    touching = {
        frozenset((model.geom(int(c.geom1)).name, model.geom(int(c.geom2)).name)) for c in data.contact
    }
    assert touching == {frozenset(("floor", f"{leg}_foot")) for leg in robot.leg_names}


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
