"""What training leaves out of a physics step is nothing that its model has."""

from __future__ import annotations

import pytest

pytest.importorskip("mujoco_warp")

import mujoco
import mujoco_warp
import numpy as np
import torch

from sprintlab.robots import load_robot
from sprintlab.training.environment.simulation import NOT_NEEDED, BatchSimulation, training_model
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


def test_a_recorded_physics_step_is_the_step(monkeypatch: pytest.MonkeyPatch) -> None:
    """To the bit, over falls and landings, from targets that change; and it is Python that it saves."""
    settings = SimulationSettings(environments=4)
    recorded, plain = (BatchSimulation(load_robot("bp2"), settings, "refined", "cpu") for _ in "ab")
    monkeypatch.setattr(plain, "_step_physics", lambda: mujoco_warp.step(plain.model, plain.data))
    launched = []
    step = mujoco_warp.step
    random = torch.Generator().manual_seed(0)
    for _ in range(10):
        target = plain.target + 0.2 * torch.randn(plain.target.shape, generator=random)
        for simulation in (recorded, plain):
            simulation.target.copy_(target)
            with monkeypatch.context() as patch:
                patch.setattr(mujoco_warp, "step", lambda *given: launched.append(given[1]) or step(*given))
                simulation.step()
        for name, value in plain.state().items():
            assert torch.equal(recorded.state()[name], value), name
    assert (plain.qvel != 0.0).all()
    assert sum(data is recorded.data for data in launched) == 2 < len(launched) == 2 + 10 * settings.substeps
