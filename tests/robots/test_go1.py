import mujoco
import numpy as np
import pytest

from sprintlab.motors import drive_torque
from sprintlab.robots import ModelOptions, build_model, load_robot

FULL = ModelOptions(collisions="full", contact_time_constant=0.002)


@pytest.fixture(scope="module")
def go1():
    return load_robot("go1")


def test_the_model_weighs_what_is_published(go1):
    published = 5.204 + 4 * (0.68 + 1.009 + 0.195862)
    for options in (ModelOptions(), ModelOptions(visuals=True), FULL):
        assert build_model(go1, options).body_mass.sum() == pytest.approx(published, abs=1e-5)


def test_there_are_no_springs(go1):
    assert go1.spring_joint_names == ()
    model = build_model(go1)
    assert (model.nq, model.nv, model.nu) == (7 + 12, 6 + 12, 12)
    assert "FL_knee" not in {model.body(i).name for i in range(model.nbody)}


def test_the_knee_has_a_gear_of_its_own(go1):
    np.testing.assert_allclose(go1.gear.ratio, np.tile([6.0, 6.0, 9.0], 4))
    np.testing.assert_allclose(go1.armature, np.tile([1.118e-4 * 36, 1.118e-4 * 36, 1.118e-4 * 81], 4))


@pytest.mark.parametrize(("joint", "torque", "speed"), [(0, 23.7, 30.1), (1, 23.7, 30.1), (2, 35.55, 20.06)])
def test_torque_and_speed_are_those_published(go1, joint, torque, speed):
    """Peak torque at a slow turn; almost nothing left at the published no-load speed."""
    velocity = np.zeros(12)
    slow = drive_torque(go1.motors, go1.gear, np.full(12, 1e3), velocity + 3.0, go1.bus_voltage)
    assert slow.torque[joint] == pytest.approx(torque, rel=0.005)
    fast = drive_torque(go1.motors, go1.gear, np.full(12, 1e3), velocity + speed, go1.bus_voltage)
    assert abs(fast.torque[joint]) < 0.02 * torque


def test_visuals_scale_with_the_robot(go1):
    """Nothing that is drawn reaches farther below the ground than a few millimetres."""
    model = build_model(go1, ModelOptions(visuals=True))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    hull = model.mesh("hull").id
    start, count = model.mesh_vertadr[hull], model.mesh_vertnum[hull]
    width = np.ptp(model.mesh_vert[start : start + count, 1])
    assert 0.06 < width < 0.14
    lowest = min(data.geom(f"{leg}_foot").xpos[2] - go1.foot_radius for leg in go1.leg_names)
    assert abs(lowest) < 0.01
