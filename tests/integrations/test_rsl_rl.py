"""rsl_rl's own runner trains on our environment, and what its storage keeps is what the actor saw."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

pytest.importorskip("rsl_rl")
pytest.importorskip("mujoco_warp")

import torch

from sprintlab.training.environment.sprint import SprintEnvironment
from sprintlab.training.settings import TrainingSettings

ROBOTS, STEPS = 4, 3
SIZES = {"class_name": "rsl_rl.models:MLPModel", "hidden_dims": [16], "activation": "elu"}
CONFIGURATION = {
    "num_steps_per_env": STEPS,
    "save_interval": 100,
    "obs_groups": {"actor": ["actor"], "critic": ["critic"]},
    "actor": {**SIZES, "distribution_cfg": {"class_name": "GaussianDistribution", "init_std": 0.5}},
    "critic": dict(SIZES),
    "algorithm": {
        "class_name": "rsl_rl.algorithms:PPO",
        "num_learning_epochs": 1,
        "num_mini_batches": 1,
        "rnd_cfg": None,
        "symmetry_cfg": None,
    },
}


@pytest.fixture(scope="module")
def environment() -> Any:
    """Imports rsl_rl when it is used: its import takes seconds, in every process that collects tests."""
    from sprintlab.integrations.rsl_rl import RslRlEnvironment

    settings = TrainingSettings()
    settings = replace(settings, simulation=replace(settings.simulation, environments=ROBOTS))
    return RslRlEnvironment(SprintEnvironment(settings, "cpu", fused=False))


def test_their_runner_trains_an_iteration(environment: Any, monkeypatch) -> None:
    from rsl_rl.runners import OnPolicyRunner

    runner = OnPolicyRunner(environment, CONFIGURATION, log_dir=None, device="cpu")
    seen: list[torch.Tensor] = []
    act, update, stored = runner.alg.act, runner.alg.update, {}

    def watched(observations):
        seen.append(observations["actor"].clone())
        return act(observations)

    def kept():
        stored["observations"] = runner.alg.storage.observations["actor"].clone()
        return update()

    monkeypatch.setattr(runner.alg, "act", watched)
    monkeypatch.setattr(runner.alg, "update", kept)
    before = [value.clone() for value in runner.alg.get_policy().parameters()]
    runner.learn(1, init_at_random_ep_len=True)
    assert torch.equal(stored["observations"], torch.stack(seen))
    assert not torch.equal(stored["observations"][0], stored["observations"][1])
    after = list(runner.alg.get_policy().parameters())
    assert any(not torch.equal(mine, theirs) for mine, theirs in zip(before, after, strict=True))
