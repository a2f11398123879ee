"""What a GPU compiles can be compiled in one piece: the tracer of ``torch.compile``, without its kernels.

A piece that the tracer cannot follow would still run, in many graphs instead of one, and slowly.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import pytest
import torch
from tests.training.small import small_settings

from sprintlab.training.environment.episodes import Ends
from sprintlab.training.environment.sprint import SprintEnvironment
from sprintlab.training.graphs import compiled
from sprintlab.training.learner.algorithm import EstimatorPpo
from sprintlab.training.learner.distributed import Workers
from sprintlab.training.learner.networks import LATENT_SIZE
from sprintlab.training.methods import method_settings
from sprintlab.training.reward_tables import hound_rewards, paper_rewards

SETTINGS = small_settings(environments=4, mini_batches=1, hidden=(16, 8))


def traced(work: Callable[..., Any]) -> Callable[..., Any]:
    torch.compiler.reset()
    return torch.compile(work, dynamic=False, fullgraph=True, backend="eager")


@pytest.fixture(scope="module")
def learner() -> EstimatorPpo:
    return EstimatorPpo(SprintEnvironment(SETTINGS, "cpu"), True, Workers())


def test_the_step_after_physics_is_one_piece() -> None:
    """With every reward that there is. The motor is no part of it."""
    tables = {**hound_rewards(), **{f"{name}_": each for name, each in paper_rewards().items()}}
    environment = SprintEnvironment(replace(SETTINGS, reward={**tables, **SETTINGS.reward}), "cpu")
    before = environment.episode_length_buf.clone()
    environment.engine.step()
    traced(environment._transition)()
    assert torch.equal(environment.episode_length_buf, before + 1)


@pytest.mark.parametrize("method", ("uniform-commands", "fixed-acceleration", "rlvrl", "lp-acrl"))
def test_every_schedule_and_its_grid_are_one_piece_each(method: str) -> None:
    environment = SprintEnvironment(method_settings(method, SETTINGS), "cpu")
    no_robot, everyone = torch.zeros(4, dtype=torch.bool), torch.ones(4, dtype=torch.bool)
    traced(environment._learn_grid)(Ends(*(no_robot for _ in Ends._fields)))
    environment.draws.refill()
    traced(environment._advance_commands)(everyone)
    assert (environment.commands.time_to_target > 0.0).all()


def test_acting_and_recording_are_one_piece_each(learner: EstimatorPpo) -> None:
    traced(learner._act_with)(torch.zeros_like(learner.environment.action))
    assert torch.equal(learner.rollout.action[:, 0], learner.rollout.mean[:, 0])
    traced(learner._record)()
    assert int(learner.rollout.step) == 1


def test_the_parts_of_an_update_are_one_piece_each(learner: EstimatorPpo) -> None:
    traced(learner._bootstrap)()
    batch = learner.rollout.policy_batch(0, 4)
    learner._policy_gradient(batch)
    plain = learner.block.gradient.clone()
    traced(learner._policy_gradient)(batch)
    torch.testing.assert_close(learner.block.gradient, plain)
    traced(learner._policy_step)()
    noise = torch.zeros(8, LATENT_SIZE)
    traced(learner._estimator_gradient)(learner.rollout.estimator_batch(0, 4, noise))
    traced(learner.estimator_block.step)()
    traced(learner._finish)()


@dataclass
class Adder:
    """Has a method as a run has."""

    number: int

    @torch.no_grad()
    def add(self, value: torch.Tensor) -> torch.Tensor:
        return value + self.number


def test_many_runs_fit_into_one_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """The compiler takes all methods under ``no_grad`` for versions of one, and refuses the ninth."""
    torch.compiler.reset()
    compile_function = torch.compile
    monkeypatch.setattr(
        torch,
        "compile",
        lambda work, options, **keywords: compile_function(work, backend="eager", **keywords),
    )
    for number in range(20):
        assert compiled(Adder(number).add, True)(torch.zeros(1)).item() == number
