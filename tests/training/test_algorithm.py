"""PPO's parts against rsl_rl, and what the fast path must not break."""

from __future__ import annotations

import copy
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest
import torch
from tests.training.small import networks

from sprintlab.robots import load_robot
from sprintlab.training.environment.sprint import SprintEnvironment
from sprintlab.training.learner.algorithm import EstimatorPpo, build_actor
from sprintlab.training.learner.annealing import DESIRED_KL
from sprintlab.training.learner.distributed import Workers
from sprintlab.training.learner.losses import (
    ENTROPY_WEIGHT,
    GAE_LAMBDA,
    PolicyBatch,
    adapted_learning_rate,
    generalized_advantages,
    log_probability,
    loss_scale,
    noise_scale_per_env,
    policy_gradients,
)
from sprintlab.training.learner.networks import LATENT_SIZE, Actor, Critic
from sprintlab.training.learner.parameters import ParameterBlock
from sprintlab.training.learner.perceptron import Perceptron
from sprintlab.training.learner.storage import Rollout
from sprintlab.training.settings import PpoSettings, SimulationSettings, TrainingSettings

ROBOTS, STEPS, HIDDEN = 6, 5, (32, 16)
PPO_SETTINGS = PpoSettings(
    steps=STEPS, epochs=2, mini_batches=1, hidden=HIDDEN, learning_rate=1e-3, precision="tf32"
)
SETTINGS = TrainingSettings(simulation=SimulationSettings(environments=ROBOTS), ppo=PPO_SETTINGS)
OBSERVATION = SETTINGS.observation.for_joints(12)
PLAIN = replace(SETTINGS, ppo=replace(PPO_SETTINGS, symmetric=False))
"""rsl_rl knows no symmetric networks."""

if TYPE_CHECKING:
    from rsl_rl.models import MLPModel


@pytest.fixture(scope="module")
def learner() -> EstimatorPpo:
    return EstimatorPpo(SprintEnvironment(SETTINGS, "cpu"), True, Workers())


def fill_rollout(learner: EstimatorPpo) -> None:
    for _ in range(STEPS):
        learner.act()
        learner.environment.advance()
        learner.record()


def rsl_model(name: str, inputs: int, outputs: int, distribution: dict | None) -> MLPModel:
    from rsl_rl.models import MLPModel
    from tensordict import TensorDict

    example = TensorDict({name: torch.zeros(ROBOTS, inputs)}, batch_size=[ROBOTS])
    return MLPModel(
        example, {name: [name]}, name, outputs, hidden_dims=list(HIDDEN), activation="elu",
        obs_normalization=False, distribution_cfg=distribution,
    )  # fmt: skip


def both(theirs: torch.nn.Module, ours: Perceptron) -> list[tuple[torch.Tensor, torch.Tensor]]:
    """Their parameters and ours, of which the columns that fill up a matrix are left out."""
    linear = [layer for layer in theirs.modules() if isinstance(layer, torch.nn.Linear)]
    pairs = []
    for one, layer in zip(linear, ours.layers, strict=True):
        pairs.append((one.weight, layer.weight[0, : one.in_features, : one.out_features].T))
        pairs.append((one.bias, layer.bias[: one.out_features]))
    return pairs


def test_an_update_is_rsl_rl_s_update() -> None:
    """Same networks, same rollout, one mini-batch an epoch: the parameters end up the same."""
    pytest.importorskip("rsl_rl")
    from rsl_rl.algorithms import PPO  # takes seconds, in every process that collects tests
    from rsl_rl.storage import RolloutStorage
    from tensordict import TensorDict

    torch.manual_seed(4)
    actor, critic = build_actor(PLAIN, load_robot("bp2")), Critic(PLAIN.ppo, OBSERVATION)
    inputs = 53 + LATENT_SIZE
    noise = {"class_name": "GaussianDistribution", "init_std": 0.8, "std_type": "scalar"}
    their_actor, their_critic = rsl_model("actor", inputs, 12, noise), rsl_model("critic", 53, 1, None)
    with torch.no_grad():
        for theirs_, ours_ in both(their_actor, actor.policy) + both(their_critic, critic.value):
            theirs_.copy_(ours_)
    rollout = Rollout(ROBOTS, STEPS, OBSERVATION, PLAIN, "cpu")
    observation = TensorDict(
        {"actor": torch.zeros(ROBOTS, inputs), "critic": torch.zeros(ROBOTS, 53)}, batch_size=[ROBOTS]
    )
    storage = RolloutStorage("rl", ROBOTS, STEPS, observation, [12], "cpu")
    theirs = PPO(
        their_actor, their_critic, storage, num_learning_epochs=2, num_mini_batches=1, clip_param=0.2,
        gamma=PPO_SETTINGS.discount, lam=GAE_LAMBDA, value_loss_coef=1.0, entropy_coef=0.005,
        learning_rate=1e-3, max_grad_norm=1.0, schedule="adaptive", desired_kl=0.01, device="cpu",
    )  # fmt: skip
    seen = None
    for _ in range(STEPS):
        seen = TensorDict(
            {"actor": torch.randn(ROBOTS, inputs), "critic": torch.randn(ROBOTS, 53)}, batch_size=[ROBOTS]
        )
        rewards, ends = torch.randn(ROBOTS), (torch.rand(ROBOTS) < 0.2).long()
        time_outs = ends * (torch.rand(ROBOTS) < 0.5)
        action = theirs.act(seen)
        written = {
            "actor_input": seen["actor"],
            "privileged": seen["critic"],
            "action": action,
            "mean": theirs.transition.distribution_params[0],
            "log_probability": theirs.transition.actions_log_prob.squeeze(-1),
            "value": theirs.transition.values[:, 0],
            "reward": rewards,
            "end": ends.float(),
            "time_out": time_outs.float(),
        }
        for name, values in written.items():
            rollout.write(name, values)
        rollout.step.add_(1)
        theirs.process_env_step(seen, rewards, ends, {"time_outs": time_outs})
    assert seen is not None
    theirs.compute_returns(seen)
    with torch.no_grad():
        last = critic.value(seen["critic"])[:, 0]
    advantage = generalized_advantages(
        rollout.reward, rollout.value, rollout.end, rollout.time_out, last, PPO_SETTINGS
    )
    rollout.returns.copy_(advantage + rollout.value)
    rollout.advantage.copy_(Workers().normalized(advantage))
    torch.testing.assert_close(rollout.returns.T, storage.returns[..., 0])
    torch.testing.assert_close(rollout.advantage.T, storage.advantages[..., 0])
    theirs.update()
    rate = run_update(actor, critic, rollout)
    for their, our in both(their_actor, actor.policy) + both(their_critic, critic.value):
        torch.testing.assert_close(our, their, rtol=1e-4, atol=2e-6)
    assert rate == pytest.approx(theirs.learning_rate)


@torch.no_grad()
def run_update(actor: Actor, critic: Critic, rollout: Rollout) -> float:
    """Our epochs as ``EstimatorPpo`` has them, without normalization; returns the last learning rate."""
    # The normalizers add 0.01 to a unit deviation: taken back here, rsl_rl normalizes nothing.
    for normalizer in (actor.normalizer, critic.normalizer):
        normalizer.variance.fill_(0.99**2)
    rate, old_std = torch.tensor(1e-3), actor.std.clone()
    policy = [*actor.policy.mixed_parameters(), (actor.std, None)]
    block = ParameterBlock([policy, critic.value.mixed_parameters()], rate)
    for _ in range(PPO_SETTINGS.epochs):
        batch = rollout.policy_batch(0, ROBOTS)
        gradients, parts = policy_gradients(actor, critic, batch, old_std, PPO_SETTINGS)
        rate.copy_(adapted_learning_rate(rate, parts[3], DESIRED_KL))
        block.write(gradients)
        block.step()
    return float(rate)


@pytest.mark.parametrize(("share", "count"), [(0.0, 0), (0.125, 8), (0.3, 19), (1.0, 64)])
def test_robots_with_little_noise_are_as_many_as_asked_for_and_in_every_mini_batch(
    share: float, count: int
) -> None:
    noise_scale = noise_scale_per_env(64, PpoSettings(low_noise_fraction=share))
    assert int((noise_scale == 0.25).sum()) == count
    assert set(noise_scale.tolist()) <= {0.25, 1.0}
    in_parts = [int((part == 0.25).sum()) for part in noise_scale.chunk(4)]
    assert max(in_parts) - min(in_parts) <= 1


def test_robots_with_little_noise_act_with_it_and_their_probabilities_know_it() -> None:
    settings = replace(SETTINGS, ppo=replace(PPO_SETTINGS, low_noise_fraction=0.5))
    learner = EstimatorPpo(SprintEnvironment(settings, "cpu"), True, Workers())
    assert bool((learner.rollout.noise_scale == 1.0).all()), "not yet"
    learner.set_phase(0.5)
    fill_rollout(learner)
    rollout, std = learner.rollout, learner.actor.std.detach()
    low = rollout.noise_scale[:, 0] < 1.0
    spread = (rollout.action - rollout.mean).std((1, 2))
    assert int(low.sum()) == ROBOTS // 2
    assert float(spread[low].max()) < 0.5 * float(spread[~low].min())
    noise = std * rollout.noise_scale.unsqueeze(-1)
    expected = torch.distributions.Normal(rollout.mean, noise).log_prob(rollout.action).sum(-1)
    torch.testing.assert_close(rollout.log_probability, expected, rtol=1e-4, atol=1e-3)
    learner._prepare()
    learner._policy_gradient(rollout.policy_batch(0, ROBOTS))
    parts = learner._parts
    assert float(parts[0]) == pytest.approx(-float(rollout.advantage.mean()), abs=1e-4)


def test_the_rollout_holds_what_was_seen_and_what_came_of_it(learner: EstimatorPpo) -> None:
    environment, rollout = learner.environment, learner.rollout
    seen, rewards = [], []
    for _ in range(STEPS):
        seen.append(environment.actor_observation.clone())
        learner.act()
        environment.advance()
        learner.record()
        rewards.append(environment.reward.clone())
    assert torch.equal(rollout.history, torch.stack(seen, 1))
    assert torch.equal(rollout.reward, torch.stack(rewards, 1))
    assert torch.equal(rollout.next_frame[:, 0], seen[1][:, -45:])
    assert int(rollout.step) == 0


def test_a_diverged_update_is_rolled_back_and_counted(learner: EstimatorPpo) -> None:
    fill_rollout(learner)
    before = {name: value.clone() for name, value in networks(learner).items()}
    learner.take_log()
    learner.rollout.reward[1, 2] = float("nan")
    learner.update()
    for name, value in networks(learner).items():
        assert torch.equal(value, before[name]), name
    assert learner.take_log().read()["rolled_back"] == 1.0
    learner.rollout.reward[1, 2] = 0.0
    learner.update()
    assert learner.take_log().read()["rolled_back"] == 1.0
    assert any(not torch.equal(value, before[name]) for name, value in networks(learner).items())


def test_a_block_does_to_its_parameters_what_adam_and_the_norm_s_limit_do_to_each() -> None:
    torch.manual_seed(1)
    modules = [torch.nn.Linear(5, 3), torch.nn.Linear(3, 2)]
    copies = [copy.deepcopy(module) for module in modules]
    rate = torch.tensor(1e-2)
    block = ParameterBlock([[(p, None) for p in module.parameters()] for module in modules], rate)
    reference = torch.optim.Adam([p for module in copies for p in module.parameters()], lr=1e-2)
    for _ in range(5):
        inputs = 30.0 * torch.randn(8, 5)
        loss = modules[1](modules[0](inputs)).square().mean()
        block.write([8.0 * each for each in torch.autograd.grad(loss, block.parameters)], 8.0)
        block.step()
        reference.zero_grad()
        copies[1](copies[0](inputs)).square().mean().backward()
        for module in copies:
            assert torch.nn.utils.clip_grad_norm_(module.parameters(), 1.0) > 1.0
        reference.step()
    for ours, theirs in zip(block.parameters, (p for m in copies for p in m.parameters()), strict=True):
        torch.testing.assert_close(ours, theirs)
        assert ours.untyped_storage().data_ptr() == block.values.untyped_storage().data_ptr()
    used = sum(parameter.numel() for parameter in block.parameters)
    assert int((block.values != 0.0).sum()) == used < block.values.numel()
    assert torch.equal(block.rounded, block.values.half())


@pytest.mark.parametrize("symmetric", [True, False])
def test_the_gradients_of_policy_and_critic_are_those_of_the_losses(symmetric: bool) -> None:
    """The losses as they are written in textbooks, through autograd; half of the ratios leave the clip."""
    torch.manual_seed(3)
    settings = replace(PPO_SETTINGS, symmetric=symmetric)
    actor = build_actor(replace(SETTINGS, ppo=settings), load_robot("bp2"))
    critic, samples = Critic(settings, OBSERVATION), 300
    seen, states = (
        torch.randn(samples, actor.policy.inward.size),
        torch.randn(samples, critic.value.inward.size),
    )
    share, action = torch.where(torch.rand(samples) < 0.5, 1.0, 0.5), torch.randn(samples, 12)
    mean, value = actor.decide(seen), critic(states)
    before = log_probability(action, mean, actor.std * share[:, None])
    values, gain = value.detach() + 0.3 * torch.randn(samples), torch.randn(samples)
    batch = PolicyBatch(
        noise_scale=share, actor_input=seen, privileged=states, action=action, mean=mean.detach(),
        log_probability=before.detach() + 0.3 * torch.randn(samples), value=values, advantage=gain,
        returns=values + torch.randn(samples),
    )  # fmt: skip
    ratio = (before - batch.log_probability).exp()
    surrogate = -torch.minimum(gain * ratio, gain * ratio.clamp(0.8, 1.2)).mean()
    near = values + (value - values).clamp(-0.2, 0.2)
    squares = torch.maximum((value - batch.returns).square(), (near - batch.returns).square()).mean()
    entropy = torch.distributions.Normal(mean, actor.std).entropy().sum(1).mean()
    parameters = [*actor.policy.parameters(), actor.std, *critic.value.parameters()]
    expected = torch.autograd.grad(surrogate + squares - ENTROPY_WEIGHT * entropy, parameters)
    with torch.no_grad():
        gradients, parts = policy_gradients(actor, critic, batch, actor.std.detach(), settings)
    torch.testing.assert_close(parts[:3], torch.stack((surrogate, squares, entropy)).detach())
    for found, wanted in zip(gradients, expected, strict=True):
        torch.testing.assert_close(found / loss_scale(samples), wanted, rtol=1e-4, atol=1e-6)


def test_float16_changes_the_losses_little_and_the_ratio_not_at_all() -> None:
    """The rollout decides in the same precision: before the first step the ratio is one, as it should be."""
    short = replace(SETTINGS, ppo=replace(PPO_SETTINGS, precision="float16"))
    rounded = EstimatorPpo(SprintEnvironment(short, "cpu"), True, Workers())
    fill_rollout(rounded)
    rounded._prepare()
    batch = rounded.rollout.policy_batch(0, ROBOTS)
    with torch.no_grad():
        (gradients, parts), (exact, exact_parts) = (
            policy_gradients(rounded.actor, rounded.critic, batch, rounded.old_std, settings)
            for settings in (short.ppo, PPO_SETTINGS)
        )
    assert float(parts[0]) == pytest.approx(-float(batch.advantage.mean()), abs=1e-5)
    assert float(parts[3]) == pytest.approx(0.0, abs=1e-6)
    torch.testing.assert_close(parts, exact_parts, rtol=0.05, atol=0.02)
    assert not torch.equal(parts, exact_parts)
    for one, other in zip(gradients, exact, strict=True):
        assert (one - other).norm() < 0.02 * other.norm()
    values = rounded.rollout.value
    assert not torch.equal(values, values.half().float()), "values in eight bits drown a step's reward"
