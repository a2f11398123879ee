"""The estimator does what the paper says, and none of what other implementations got wrong."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from sprintlab.control import ESTIMATE_SIZE
from sprintlab.robots import load_robot
from sprintlab.training.learner.algorithm import build_actor
from sprintlab.training.learner.losses import (
    CONTACT_WEIGHT,
    LATENT_WEIGHT,
    EstimatorBatch,
    estimator_gradients,
)
from sprintlab.training.learner.networks import LATENT_SIZE, Actor
from sprintlab.training.learner.parameters import ParameterBlock
from sprintlab.training.settings import TrainingSettings

SETTINGS = TrainingSettings()
OBSERVATION = SETTINGS.observation.for_joints(12)
HISTORY, COMMAND = OBSERVATION.input_size, OBSERVATION.place("command")
SAMPLES = 64


@pytest.fixture
def actor() -> Actor:
    torch.manual_seed(0)
    return build_actor(SETTINGS, load_robot("bp2"))


def estimator_batch(**changes: torch.Tensor) -> EstimatorBatch:
    generator = torch.Generator().manual_seed(1)

    def normal(*shape: int) -> torch.Tensor:
        return torch.randn(*shape, generator=generator)

    privileged = torch.cat((normal(SAMPLES, 4), (normal(SAMPLES, 4) > 0).float()), 1)
    batch = EstimatorBatch(
        history=normal(SAMPLES, HISTORY),
        privileged=privileged,
        next_frame=normal(SAMPLES, 45),
        valid=torch.ones(SAMPLES),
        noise=normal(SAMPLES, LATENT_SIZE),
    )
    return batch._replace(**changes)


def losses(actor: Actor, batch: EstimatorBatch) -> torch.Tensor:
    with torch.no_grad():
        return estimator_gradients(actor, batch)[1]


@pytest.mark.parametrize("symmetric", [True, False])
def test_the_gradients_are_those_of_the_losses(symmetric: bool) -> None:
    """The textbook's losses through autograd; some variances are beyond their limits."""
    torch.manual_seed(2)
    actor = build_actor(replace(SETTINGS, ppo=replace(SETTINGS.ppo, symmetric=symmetric)), load_robot("bp2"))
    estimator = actor.estimator
    with torch.no_grad():
        estimator.encoder.layers[-1].weight *= 20.0
    batch = estimator_batch(valid=(torch.rand(SAMPLES) < 0.7).float())
    encoding = estimator(actor.normalized_frames(batch.history))
    log_variance = encoding.log_variance.clamp(-8.0, 4.0)
    assert not torch.equal(log_variance, encoding.log_variance)
    latent = torch.distributions.Normal(encoding.mean, (0.5 * log_variance).exp())
    frame = (
        estimator.decoder(torch.cat((encoding.raw, latent.mean + latent.stddev * batch.noise), 1))
        * actor.seen
    )
    error = (frame - actor.normalized_frames(batch.next_frame)).square().mean(1)
    wanted = estimator.scaled_privileged(batch.privileged)
    parts = (
        (encoding.raw[:, :4] - wanted[:, :4]).square().mean(),
        -torch.distributions.Bernoulli(logits=encoding.raw[:, 4:]).log_prob(wanted[:, 4:]).mean(),
        error[batch.valid > 0.0].mean(),
        torch.distributions.kl_divergence(latent, torch.distributions.Normal(0.0, 1.0)).sum(1).mean(),
    )
    parameters = [*estimator.encoder.parameters(), *estimator.decoder.parameters()]
    loss = parts[0] + CONTACT_WEIGHT * parts[1] + parts[2] + LATENT_WEIGHT * parts[3]
    expected = torch.autograd.grad(loss, parameters)
    with torch.no_grad():
        gradients, found = estimator_gradients(actor, batch)
    torch.testing.assert_close(found, torch.stack(parts).detach())
    for one, other in zip(gradients, expected, strict=True):
        torch.testing.assert_close(one, other, rtol=1e-3, atol=1e-5)


def test_a_pair_across_an_episode_s_end_teaches_the_decoder_nothing(actor: Actor) -> None:
    valid = torch.ones(SAMPLES)
    valid[::2] = 0.0
    batch = estimator_batch(valid=valid)
    nonsense = batch.next_frame.clone()
    nonsense[::2] = 1e3
    parts = [losses(actor, batch._replace(next_frame=frames)) for frames in (batch.next_frame, nonsense)]
    assert torch.equal(*parts)
    everything = batch._replace(next_frame=nonsense, valid=torch.ones(SAMPLES))
    assert losses(actor, everything)[2] > 2 * parts[0][2]


def test_the_policy_acts_on_the_mean_of_the_latent(actor: Actor) -> None:
    history, zeros = torch.randn(3, HISTORY), torch.zeros(3, ESTIMATE_SIZE)
    first, second = (actor(history, zeros)[0] for _ in range(2))
    assert torch.equal(first, second)
    actor_input, _ = actor.perceive(history, zeros)
    latent = actor.estimator(actor.normalized_frames(history)).mean
    assert torch.equal(actor_input[:, 53 : 53 + LATENT_SIZE], latent)


def test_the_estimator_does_not_see_the_command_and_the_policy_does() -> None:
    history = torch.randn(4, HISTORY)
    other = history.clone().view(4, -1, 45)
    other[..., COMMAND] += 3.0
    other = other.view(4, HISTORY)
    blind = build_actor(SETTINGS, load_robot("bp2"))
    zeros = torch.zeros(4, ESTIMATE_SIZE)
    assert torch.equal(blind.perceive(history, zeros)[1], blind.perceive(other, zeros)[1])
    assert not torch.equal(blind(history, zeros)[0], blind(other, zeros)[0])


def test_the_estimate_is_low_passed_from_its_last_value(actor: Actor) -> None:
    history = torch.randn(5, HISTORY)
    with torch.no_grad():
        value = actor.estimator.physical(actor.estimator(actor.normalized_frames(history)).raw)
        estimate = torch.zeros(5, ESTIMATE_SIZE)
        first = actor.perceive(history, estimate)[1]
        for _ in range(40):
            estimate = actor.perceive(history, estimate)[1]
    torch.testing.assert_close(first / value, torch.full_like(value, 0.3141), rtol=1e-3, atol=1e-3)
    torch.testing.assert_close(estimate, value, rtol=1e-4, atol=1e-4)


def test_the_estimator_learns_velocity_height_and_contact(actor: Actor) -> None:
    """On histories that hold the answer, a hundred steps bring the losses down several times."""
    privileged = torch.cat((torch.randn(SAMPLES, 4), (torch.randn(SAMPLES, 4) > 0).float()), 1)
    privileged[:, 3] = 0.5 + 0.05 * privileged[:, 3]
    history = 0.1 * torch.randn(SAMPLES, HISTORY)
    history[:, -12:-4] = privileged
    batch = estimator_batch(history=history, privileged=privileged)
    networks = (actor.estimator.encoder, actor.estimator.decoder)
    block = ParameterBlock([[p for each in networks for p in each.mixed_parameters()]], torch.tensor(3e-3))
    with torch.no_grad():
        history_of_parts = []
        for _ in range(150):
            gradients, parts = estimator_gradients(actor, batch)
            block.write(gradients)
            block.step()
            history_of_parts.append(parts)
        first, last = history_of_parts[0], history_of_parts[-1]
        assert (last[:2] < 0.2 * first[:2]).all()
        value = actor.estimator.physical(actor.estimator(actor.normalized_frames(history)).raw)
    assert (value[:, :3] - privileged[:, :3]).abs().mean() < 0.3
    assert ((value[:, 4:] > 0.5) == (privileged[:, 4:] > 0.5)).float().mean() > 0.95
