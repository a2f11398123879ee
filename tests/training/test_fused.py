"""On a GPU, graphs and compiled kernels do what the plain code does, on the same random numbers."""

from __future__ import annotations

import pytest
import torch
from tests.training.small import copy_tensors, small_settings, tensors

from sprintlab.training.runs.runner import Runner

pytestmark = pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device")
SETTINGS = small_settings(environments=256, steps=8, hidden=(64, 32), ppo={"epochs": 2})


@pytest.fixture(scope="module")
def pair() -> tuple[Runner, Runner]:
    """The same run, fused and plain."""
    fused, plain = (Runner(SETTINGS, "cuda:0", "test", fused=fused) for fused in (True, False))
    torch.set_float32_matmul_precision("highest")
    return fused, plain


def test_every_step_is_the_plain_step(pair: tuple[Runner, Runner]) -> None:
    fused, plain = (runner.environment for runner in pair)
    ended = 0
    for _ in range(60):
        copy_tensors(tensors(fused), plain)
        action = torch.randn(fused.num_envs, fused.num_actions, device="cuda")
        for environment in (fused, plain):
            environment.write_action(action)
        fused.advance()
        plain.engine.step()
        plain.draws.block.copy_(fused.draws.block)
        plain._transition()
        ended += int(fused.done.sum())
        for name, value in tensors(fused).items():
            expected = tensors(plain)[name]
            worst = float((value.double() - expected.double()).abs().max())
            torch.testing.assert_close(
                value, expected, rtol=1e-4, atol=1e-4, msg=f"{name} differs by up to {worst}"
            )
    assert 0 < ended < 60 * fused.num_envs


def test_an_update_is_the_plain_update(pair: tuple[Runner, Runner]) -> None:
    fused, plain = (runner.learner for runner in pair)
    for _ in range(SETTINGS.ppo.steps):
        fused.act()
        fused.environment.advance()
        fused.record()
    plain.load_state_dict(fused.state_dict())
    for name, tensor in vars(fused.rollout).items():
        if isinstance(tensor, torch.Tensor):
            getattr(plain.rollout, name).copy_(tensor)
    copy_tensors(tensors(fused.environment), plain.environment)
    fused.update()
    plain.update()
    for one, other in ((fused.actor.policy, plain.actor.policy), (fused.critic, plain.critic)):
        for name, value in one.state_dict().items():
            torch.testing.assert_close(value, other.state_dict()[name], rtol=1e-2, atol=2e-4)
