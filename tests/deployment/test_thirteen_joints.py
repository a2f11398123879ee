"""Safety and poses of a robot with an active waist."""

import mujoco
import numpy as np
import pytest
from tests.deployment.messages import make_state

from sprintlab.deployment.controller.legs import Legs, folded_pose, tucked_pose
from sprintlab.deployment.safety import Fault, SafetySettings, StateMonitor
from sprintlab.robots import build_model, load_robot

WAIST, BP2 = load_robot("bp2-waist"), load_robot("bp2")


def test_a_state_of_another_robot_is_implausible() -> None:
    monitor = StateMonitor(WAIST, SafetySettings())
    for state in (make_state(), make_state(joint_position=np.zeros(13))):
        assert monitor.accept(state, 0.0) == [Fault.STATE_IMPLAUSIBLE]
    assert monitor.last is None


def test_the_legs_of_a_straight_waist_are_those_of_bp2() -> None:
    for pose in (folded_pose, tucked_pose):
        np.testing.assert_array_equal(pose(WAIST), [*pose(BP2), 0.0])
    legs, other = Legs(WAIST), Legs(BP2)
    feet = legs.feet(WAIST.default_pose)
    np.testing.assert_array_equal(feet, other.feet(BP2.default_pose))
    np.testing.assert_allclose(legs.pose(feet), WAIST.default_pose, atol=1e-12)


def test_feet_and_the_waists_torque_are_those_of_the_model() -> None:
    """Against MuJoCo: where the feet of a bent waist are, and what carries the robot on four feet."""
    model = build_model(WAIST)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    pose = WAIST.default_pose + 0.1 * np.sin(np.arange(13.0))
    for name, angle in zip(WAIST.joint_names, pose, strict=True):
        data.joint(name).qpos[0] = angle
    mujoco.mj_forward(model, data)
    feet = np.array([data.geom(f"{leg}_foot").xpos for leg in WAIST.leg_names]) - data.body("trunk").xpos
    np.testing.assert_allclose(Legs(WAIST).feet(pose), feet, atol=1e-9)

    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    loads, waist = np.full(4, 9.81 * WAIST.total_mass / 4), model.joint("waist").dofadr[0]
    lift, jacobian = 0.0, np.zeros((3, model.nv))
    for leg, load in zip(WAIST.leg_names, loads, strict=True):
        mujoco.mj_jac(
            model, data, jacobian, None, data.geom(f"{leg}_foot").xpos, data.body(f"{leg}_shank").id
        )
        lift += load * jacobian[2, waist]
    wanted = data.qfrc_bias[waist] - lift
    assert Legs(WAIST).carrying_torque(WAIST.default_pose, loads)[12] == pytest.approx(wanted, rel=1e-6)
