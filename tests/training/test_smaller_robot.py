"""The default recipe at a smaller robot's size: a few steps on the CPU."""

from dataclasses import replace

import pytest

torch = pytest.importorskip("torch")
pytest.importorskip("torch")


def test_sixteen_go1_stand_and_move_on_the_cpu():
    from sprintlab.training.environment.sprint import SprintEnvironment
    from sprintlab.training.methods import method

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
