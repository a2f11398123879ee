"""What the networks are trained on: advantages, PPO's losses and the estimator's, as pure functions.

PPO is Schulman et al. 2017 with the details of rsl_rl 5.4: clipped value loss, time-outs bootstrapped with
the value before the step, advantages normalized over the whole rollout, learning rate adapted to the
divergence.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch.nn import functional

from sprintlab.training.learner.networks import CONTACT_START, Actor, Critic
from sprintlab.training.settings import PpoSettings

LEARNING_RATE_RANGE = (1e-5, 1e-2)
CONTACT_WEIGHT = 0.2
"""Of the contacts' cross-entropy in the estimator's loss."""
LATENT_WEIGHT = 1e-3
"""Beta, of the latent's divergence from a standard normal. With the reconstruction a mean over 45 numbers,
more than a few thousandths makes the latent collapse."""
_LOG_TWO_PI = math.log(2.0 * math.pi)


def log_probability(action: torch.Tensor, mean: torch.Tensor, std: torch.Tensor) -> torch.Tensor:
    """Log density ``(n,)`` of actions ``(n, k)`` under diagonal Gaussians with deviations ``(n, k)``."""
    scaled = (action - mean) / std
    return -0.5 * (scaled.square() + _LOG_TWO_PI).sum(-1) - std.log().sum(-1)


def robot_noise(std: torch.Tensor, noise_scale: torch.Tensor) -> torch.Tensor:
    """Deviations of the actions of robots ``(n, k)`` from the policy's ``(k,)`` and each one's share."""
    return std * noise_scale.unsqueeze(-1)


def noise_scale_per_env(robots: int, settings: PpoSettings) -> torch.Tensor:
    """Factor of the action noise of each robot ``(robots,)``: those with little noise spread evenly."""
    place = torch.arange(robots + 1, dtype=torch.float64) * settings.low_noise_fraction + 1e-9
    low = place.floor().diff() > 0.0
    return torch.where(low, settings.low_noise_scale, 1.0)


def entropy(std: torch.Tensor) -> torch.Tensor:
    """Entropy of a diagonal Gaussian ``()`` with deviations ``(k,)``."""
    return (0.5 + 0.5 * _LOG_TWO_PI + std.log()).sum()


def divergence(
    old_mean: torch.Tensor, old_std: torch.Tensor, mean: torch.Tensor, std: torch.Tensor
) -> torch.Tensor:
    """Mean Kullback-Leibler divergence ``()`` of the new Gaussians from the old ones ``(n, k)``."""
    moved = (old_std.square() + (old_mean - mean).square()) / (2.0 * std.square())
    return (std.log() - old_std.log() + moved - 0.5).sum(-1).mean()


def generalized_advantages(
    rewards: torch.Tensor,
    values: torch.Tensor,
    ends: torch.Tensor,
    time_outs: torch.Tensor,
    last_value: torch.Tensor,
    settings: PpoSettings,
) -> torch.Tensor:
    """Advantages ``(n, T)`` (Schulman et al. 2016).

    Args:
        rewards: ``(n, T)``.
        values: of the states before each step ``(n, T)``.
        ends: 1 where the episode ended with the step; the share of the future that ended where a constraint
            was broken ``(n, T)``.
        time_outs: 1 where the episode was truncated: its future is bootstrapped ``(n, T)``.
        last_value: of the states after the last step ``(n,)``.
        settings: discount and lambda.
    """
    rewards = rewards + settings.discount * values * time_outs
    not_done = 1.0 - ends
    columns, advantage, following = [], torch.zeros_like(last_value), last_value
    for step in range(rewards.shape[1] - 1, -1, -1):
        discounted = not_done[:, step] * settings.discount
        td_error = rewards[:, step] + discounted * following - values[:, step]
        advantage = td_error + discounted * settings.gae * advantage
        following = values[:, step]
        columns.append(advantage)
    return torch.stack(columns[::-1], 1)


class PolicyBatch(NamedTuple):
    """Transitions of a mini-batch of ``m`` samples.

    Attributes:
        noise_scale: share of the action noise that the robot had ``(m,)``.
        actor_input: what the policy network saw ``(m, 70)``: stored, so that the likelihood ratio compares
            policies on the same input, and no gradient reaches the estimator.
        privileged: what the critic saw ``(m, 54)``.
        action: taken ``(m, k)``.
        mean: of the action's distribution then ``(m, k)``.
        log_probability: of the action then ``(m,)``.
        value: estimated then ``(m,)``.
        advantage: normalized ``(m,)``.
        returns: ``(m,)``.
    """

    noise_scale: torch.Tensor
    actor_input: torch.Tensor
    privileged: torch.Tensor
    action: torch.Tensor
    mean: torch.Tensor
    log_probability: torch.Tensor
    value: torch.Tensor
    advantage: torch.Tensor
    returns: torch.Tensor


def decide_and_value(
    actor: Actor, critic: Critic, actor_input: torch.Tensor, privileged: torch.Tensor, settings: PpoSettings
) -> tuple[torch.Tensor, torch.Tensor]:
    """Mean actions ``(m, k)`` and values ``(m,)`` in the precision of the settings.

    Rollout and update both call this: the likelihood ratio then compares policies, not number formats.
    """
    with torch.autocast(privileged.device.type, torch.float16, enabled=settings.precision == "float16"):
        mean, value = actor.decide(actor_input), critic(privileged)
    return mean.float(), value.float()


def policy_losses(
    actor: Actor, critic: Critic, batch: PolicyBatch, old_std: torch.Tensor, settings: PpoSettings
) -> tuple[torch.Tensor, torch.Tensor]:
    """The loss ``()``; surrogate, value loss, entropy, divergence ``(4,)`` without gradient.

    Entropy and divergence are those of the policy with all its noise: a few robots with little noise, for
    whom the same change of the mean is many deviations, shall not set the pace.
    """
    mean, value = decide_and_value(actor, critic, batch.actor_input, batch.privileged, settings)
    noise = robot_noise(actor.std, batch.noise_scale)
    ratio = torch.exp(log_probability(batch.action, mean, noise) - batch.log_probability)
    limited = ratio.clamp(1.0 - settings.clip, 1.0 + settings.clip)
    surrogate = torch.maximum(-batch.advantage * ratio, -batch.advantage * limited).mean()
    near = batch.value + (value - batch.value).clamp(-settings.clip, settings.clip)
    value_loss = torch.maximum((value - batch.returns).square(), (near - batch.returns).square()).mean()
    bonus = entropy(actor.std)
    loss = surrogate + value_loss - settings.entropy * bonus
    moved = divergence(batch.mean, old_std, mean.detach(), actor.std.detach())
    return loss, torch.stack((surrogate.detach(), value_loss.detach(), bonus.detach(), moved))


def adapted_learning_rate(
    rate: torch.Tensor, moved: torch.Tensor, desired: torch.Tensor | float
) -> torch.Tensor:
    """Slower by 1.5 where the policy moved twice too far, faster where it moved less than half: ``()``."""
    faster = (moved < 0.5 * desired) & (moved > 0.0)
    steps = faster.float() - (moved > 2.0 * desired).float()
    return (rate * torch.exp(math.log(1.5) * steps)).clamp(*LEARNING_RATE_RANGE)


class EstimatorBatch(NamedTuple):
    """What the estimator learns from, ``m`` samples.

    Attributes:
        history: ``(m, H * 45)``.
        privileged: body velocity 3, height 1, contacts 4 at the end of the history ``(m, 8)``.
        next_frame: the frame one step later ``(m, 45)``.
        valid: 1 where that frame belongs to the same episode ``(m,)``.
        noise: standard normal ``(m, z)``.
    """

    history: torch.Tensor
    privileged: torch.Tensor
    next_frame: torch.Tensor
    valid: torch.Tensor
    noise: torch.Tensor


def estimator_losses(actor: Actor, batch: EstimatorBatch) -> tuple[torch.Tensor, torch.Tensor]:
    """The loss ``()``; velocity-height, contact, reconstruction and latent losses ``(4,)`` without gradient.

    Mean squared error on the scaled velocity and height, binary cross-entropy on the contacts, mean squared
    error of the decoded next frame where the episode goes on, and the divergence of the latent from a
    standard normal, a mean over samples like the others (a sum would drown them).
    """
    encoding = actor.estimator(actor.normalized_frames(batch.history))
    state = functional.mse_loss(
        encoding.raw[:, :CONTACT_START], actor.estimator.scaled_privileged(batch.privileged)
    )
    contact = functional.binary_cross_entropy_with_logits(
        encoding.raw[:, CONTACT_START:], batch.privileged[:, CONTACT_START:]
    )
    target = actor.normalized_frames(batch.next_frame)
    decoded = actor.estimator.decode(encoding, batch.noise) * actor.seen
    error = (decoded - target).square().mean(1)
    reconstruction = (error * batch.valid).sum() / batch.valid.sum().clamp(min=1.0)
    spread = encoding.log_variance
    latent = 0.5 * (encoding.mean.square() + spread.exp() - spread - 1.0).sum(1).mean()
    parts = torch.stack((state, contact, reconstruction, latent))
    loss = state + CONTACT_WEIGHT * contact + reconstruction + LATENT_WEIGHT * latent
    return loss, parts.detach()
