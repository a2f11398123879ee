"""What training leaves out of a physics step is nothing that its model has."""

from __future__ import annotations

import pytest

pytest.importorskip("mujoco_warp")

import mujoco
import numpy as np

from sprintlab.robots import load_robot
from sprintlab.training.environment.simulation import NOT_NEEDED, training_model
from sprintlab.training.settings import SimulationSettings


@pytest.mark.parametrize("robot", ["bp2", "go1"])
def test_disabled_parts_have_no_work(robot: str) -> None:
    model = training_model(load_robot(robot), SimulationSettings())
    assert all(model.opt.disableflags & part for part in NOT_NEEDED)
    assert model.nsensor == 0
    assert not model.dof_frictionloss.any()
    assert not model.jnt_limited.any()


def test_the_robot_moves_as_with_everything_enabled() -> None:
    cut = training_model(load_robot("bp2"), SimulationSettings())
    whole = training_model(load_robot("bp2"), SimulationSettings())
    for part in NOT_NEEDED:
        whole.opt.disableflags &= ~int(part)
    states = []
    for model in (cut, whole):
        data = mujoco.MjData(model)
        mujoco.mj_resetDataKeyframe(model, data, 0)
        data.qvel[0] = 1.0
        for _ in range(200):
            mujoco.mj_step(model, data)
        states.append(data.qpos.copy())
    np.testing.assert_array_equal(states[0], states[1])
