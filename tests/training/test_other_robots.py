"""Robots of another size or with another joint through a training."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from sprintlab.api.races import race
from sprintlab.api.training import export, train
from sprintlab.control import load_policy
from sprintlab.training.environment.sprint import SprintEnvironment
from sprintlab.training.methods import method
from sprintlab.training.settings import TrainingSettings


def test_sixteen_go1_stand_and_move_on_the_cpu():
    settings = method(robot="go1")
    settings = replace(settings, simulation=replace(settings.simulation, environments=16))
    environment = SprintEnvironment(settings, device="cpu")
    for _ in range(10):
        observation, reward, done, _ = environment.step(torch.zeros(16, 12))
    assert observation["actor"].shape == (16, 450)
    assert torch.isfinite(observation["actor"]).all()
    assert torch.isfinite(reward).all()
    assert done.float().mean() < 0.2
    assert environment.engine.qpos.shape == (16, 19)
    height = environment.engine.qpos[:, 2].median()
    assert 0.8 * environment.robot.standing_height < height < 1.1 * environment.robot.standing_height


@pytest.mark.slow
@pytest.mark.usefixtures("brief_trials")
def test_a_robot_with_a_waist_trains_exports_and_races(tmp_path) -> None:
    settings = TrainingSettings(robot="bp2-waist")
    tiny = replace(settings.ppo, steps=2, mini_batches=1, epochs=1, hidden=(16,))
    settings = replace(settings, ppo=tiny)
    trained = train(
        settings,
        output=tmp_path / "run",
        iterations=2,
        environments=4,
        device="cpu",
        fused=False,
        plain=True,
    )
    export(trained.checkpoint, tmp_path / "policy.onnx")
    policy = load_policy(tmp_path / "policy.onnx")
    assert policy.contract.joint_names[-1] == "waist" and len(policy.contract.joint_names) == 13
    assert policy.decide(np.zeros((1, 10 * 48), dtype=np.float32)).action.shape == (1, 13)

    policy = tmp_path / "policy.onnx"
    result = race(policy, top_speed=0.5, distance=0.05, trials=1, workers=1)
    assert result.robot.name == "bp2-waist"
    assert len(result.plot("torque_speed").axes) == 16 and len(result.plot("power").axes) == 2
