"""The Go1's recipe: its settings, a few steps on the CPU, and one iteration of each sitting."""

import runpy
from dataclasses import replace
from pathlib import Path

import pytest

torch = pytest.importorskip("torch")
pytest.importorskip("rsl_rl")
pytest.importorskip("mujoco_warp")

RECIPE = Path(__file__).parents[2] / "recipes" / "go1_sprint.py"


@pytest.fixture(scope="module")
def recipe():
    return runpy.run_path(str(RECIPE))


def test_both_sittings_train_the_go1_up_to_its_limit(recipe):
    first, second = recipe["first_settings"](), recipe["second_settings"]()
    assert first.robot == second.robot == "go1"
    assert first.stages.second_top == second.stages.second_top == 9.0
    assert second.schedule.targets.top_share == 0.75
    assert abs(second.rewards.joint_acceleration.second) < abs(first.rewards.joint_acceleration.first)


def test_sixteen_robots_stand_and_move_on_the_cpu(recipe):
    from sprintlab.training.environment import SprintEnvironment

    settings = recipe["first_settings"]()
    settings = replace(settings, simulation=replace(settings.simulation, environments=16))
    environment = SprintEnvironment(settings, device="cpu")
    for _ in range(10):
        observation, reward, done, _ = environment.step(torch.zeros(16, 12))
    assert observation["actor"].shape == (16, 225)
    assert torch.isfinite(observation["actor"]).all()
    assert torch.isfinite(reward).all()
    assert done.float().mean() < 0.2
    assert environment.simulation.qpos.shape == (16, 19)
    height = environment.simulation.qpos[:, 2].median()
    assert 0.8 * environment.robot.standing_height < height < 1.1 * environment.robot.standing_height


@pytest.mark.slow
def test_one_iteration_of_each_sitting_leaves_a_checkpoint(recipe, tmp_path):
    options = recipe["Options"](output=tmp_path, minutes=10.0, iterations=1, environments=16, device="cpu")
    checkpoint = recipe["main"](options)
    assert checkpoint == tmp_path / "second" / "checkpoint.pt"
    assert checkpoint.is_file()
    assert (tmp_path / "first" / "log.jsonl").is_file()
