"""The Go1's recipe: its settings, a few steps on the CPU, and one iteration."""

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


def test_it_trains_the_go1_up_to_its_limit_with_bp2_s_weights(recipe):
    from sprintlab.training.settings import TrainingSettings

    settings, defaults = recipe["go1_settings"](), TrainingSettings()
    assert settings.robot == "go1"
    assert settings.stages.second_top == 9.0
    assert settings.rewards.penalties() == defaults.rewards.penalties()
    assert settings.episodes.leg_distance_limit < defaults.episodes.leg_distance_limit


def test_sixteen_robots_stand_and_move_on_the_cpu(recipe):
    from sprintlab.training.environment.sprint import SprintEnvironment

    settings = recipe["go1_settings"]()
    settings = replace(settings, simulation=replace(settings.simulation, environments=16))
    environment = SprintEnvironment(settings, device="cpu")
    for _ in range(10):
        observation, reward, done, _ = environment.step(torch.zeros(16, 12))
    assert observation["actor"].shape == (16, 450)
    assert torch.isfinite(observation["actor"]).all()
    assert torch.isfinite(reward).all()
    assert done.float().mean() < 0.2
    assert environment.simulation.qpos.shape == (16, 19)
    height = environment.simulation.qpos[:, 2].median()
    assert 0.8 * environment.robot.standing_height < height < 1.1 * environment.robot.standing_height


@pytest.mark.slow
def test_one_iteration_leaves_a_checkpoint_and_a_log(recipe, tmp_path, monkeypatch):
    from sprintlab.api.training import ScriptOptions
    from sprintlab.training.runs.cloud import record_cloud

    settings = recipe["go1_settings"]()
    small = replace(settings, ppo=replace(settings.ppo, hidden=(16,), steps=2))
    monkeypatch.setitem(recipe["main"].__globals__, "go1_settings", lambda: small)
    monkeypatch.setattr(record_cloud, "__defaults__", (4, 0))  # steps that are looked at, and before them
    options = ScriptOptions(output=tmp_path, iterations=1, environments=16, device="cpu")
    assert recipe["main"](options) == tmp_path / "checkpoint.pt"
    assert (tmp_path / "checkpoint.pt").is_file()
    assert (tmp_path / "log.jsonl").is_file()
