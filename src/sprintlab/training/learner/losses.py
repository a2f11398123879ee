"""What the networks are trained on: advantages, PPO's losses and the estimator's, with their gradients.

PPO is Schulman et al. 2017 with the details of rsl_rl 5.4: clipped value loss, time-outs bootstrapped with
the value before the step, advantages normalized over the whole rollout, learning rate adapted to the
divergence.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch.nn import functional

from sprintlab.control import ESTIMATE_SIZE
from sprintlab.training.learner.networks import CONTACT_START, LOG_VARIANCE_RANGE, Actor, Critic
from sprintlab.training.settings import PpoSettings

LEARNING_RATE_RANGE = (1e-5, 1e-2)
GAE_LAMBDA = 0.95
"""Lambda of the generalized advantage estimate."""
CLIP = 0.2
"""Clip range of the likelihood ratio."""
ENTROPY_WEIGHT = 0.005
"""Weight of the entropy bonus."""
LOW_NOISE_SCALE = 0.25
"""Factor of the action noise of robots that act with less noise."""
CONTACT_WEIGHT = 0.2
"""Weight of the contacts' cross-entropy in the estimator's loss."""
LATENT_WEIGHT = 1e-3
"""Beta, of the latent's divergence from a standard normal. With the reconstruction a mean over 45 numbers,
more than a few thousandths makes the latent collapse."""
_SAMPLES = 256
"""A mean over so many samples goes back through the layers as it is."""
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
    return torch.where(low, LOW_NOISE_SCALE, 1.0)


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
        values: value estimates of the states before each step ``(n, T)``.
        ends: 1 where the episode ended with the step; the share of the future that ended where a constraint
            was broken ``(n, T)``.
        time_outs: 1 where the episode was truncated: its future is bootstrapped ``(n, T)``.
        last_value: value estimate of the states after the last step ``(n,)``.
    """
    rewards = rewards + settings.discount * values * time_outs
    not_done = 1.0 - ends
    columns, advantage, following = [], torch.zeros_like(last_value), last_value
    for step in range(rewards.shape[1] - 1, -1, -1):
        discounted = not_done[:, step] * settings.discount
        td_error = rewards[:, step] + discounted * following - values[:, step]
        advantage = td_error + discounted * GAE_LAMBDA * advantage
        following = values[:, step]
        columns.append(advantage)
    return torch.stack(columns[::-1], 1)


class PolicyBatch(NamedTuple):
    """Transitions of a mini-batch of ``m`` samples."""

    noise_scale: torch.Tensor  # share of the action noise that the robot had (m,)
    actor_input: torch.Tensor
    """What the policy network saw ``(m, 70)``: stored, so that the likelihood ratio compares policies on the
    same input, and no gradient reaches the estimator."""
    privileged: torch.Tensor  # what the critic saw (m, 54)
    action: torch.Tensor  # taken (m, k)
    mean: torch.Tensor  # mean of the action's distribution then (m, k)
    log_probability: torch.Tensor  # log-probability of the action then (m,)
    value: torch.Tensor  # estimated then (m,)
    advantage: torch.Tensor  # normalized (m,)
    returns: torch.Tensor  # (m,)


def precision_of(settings: PpoSettings) -> torch.dtype:
    """Number format of the products in policy and critic.

    Rollout and update have the same: the likelihood ratio then compares policies, not number formats.
    """
    return torch.float16 if settings.precision == "float16" else torch.float32


class PolicyLosses(NamedTuple):
    """PPO's losses, and the gradient of ``surrogate + value loss - weight * entropy``."""

    parts: torch.Tensor  # surrogate, value loss, entropy, divergence (4,)
    mean: torch.Tensor  # gradient by the mean actions (m, k)
    std: torch.Tensor  # gradient by the policy's deviations (k,)
    value: torch.Tensor  # gradient by the values (m,)


def policy_losses(
    mean: torch.Tensor, std: torch.Tensor, value: torch.Tensor, batch: PolicyBatch, old_std: torch.Tensor
) -> PolicyLosses:
    """Losses of mean actions ``(m, k)``, the policy's deviations ``(k,)`` and values ``(m,)``.

    Entropy and divergence are those of the policy with all its noise: a few robots with little noise, for
    whom the same change of the mean is many deviations, shall not set the pace.
    """
    samples, clip = len(value), CLIP
    noise = robot_noise(std, batch.noise_scale)
    scaled = (batch.action - mean) / noise
    ratio = torch.exp(log_probability(batch.action, mean, noise) - batch.log_probability)
    free, limited = -batch.advantage * ratio, -batch.advantage * ratio.clamp(1.0 - clip, 1.0 + clip)
    by_log_probability = torch.where(free >= limited, free, 0.0)[:, None] / (samples * noise)
    by_std = (by_log_probability * (scaled.square() - 1.0) * batch.noise_scale[:, None]).sum(0)
    change, error = value - batch.value, value - batch.returns
    near_error = batch.value + change.clamp(-clip, clip) - batch.returns
    by_near = torch.where(change.abs() <= clip, near_error, 0.0)
    by_value = torch.where(error.square() >= near_error.square(), error, by_near)
    parts = (
        torch.maximum(free, limited).mean(),
        torch.maximum(error.square(), near_error.square()).mean(),
        (0.5 + 0.5 * _LOG_TWO_PI + std.log()).sum(),
        divergence(batch.mean, old_std, mean, std),
    )
    return PolicyLosses(
        parts=torch.stack(parts),
        mean=by_log_probability * scaled,
        std=by_std - ENTROPY_WEIGHT / std,
        value=by_value * (2.0 / samples),
    )


def policy_gradients(
    actor: Actor, critic: Critic, batch: PolicyBatch, old_std: torch.Tensor, settings: PpoSettings
) -> tuple[list[torch.Tensor], torch.Tensor]:
    """Gradients of policy, its deviations and critic, in this order, and the losses' parts ``(4,)``."""
    precision = precision_of(settings)
    mean, decisions = actor.policy.recorded(actor.normalizer(batch.actor_input), precision)
    value, valuations = critic.value.recorded(critic.normalizer(batch.privileged), precision)
    losses = policy_losses(mean, actor.std, value[:, 0], batch, old_std)
    scale = loss_scale(len(mean))
    of_policy, _ = actor.policy.gradients(decisions, scale * losses.mean)
    of_critic, _ = critic.value.gradients(valuations, scale * losses.value[:, None])
    return [*of_policy, scale * losses.std, *of_critic], losses.parts


def loss_scale(samples: int) -> float:
    """By what losses are made larger before they go back through the layers: a power of two.

    Half precision loses a single sample's share of a mean over tens of thousands.
    """
    return 2.0 ** round(math.log2(max(1.0, samples / _SAMPLES)))


def adapted_learning_rate(
    rate: torch.Tensor, moved: torch.Tensor, desired: torch.Tensor | float
) -> torch.Tensor:
    """Slower by 1.5 where the policy moved twice too far, faster where it moved less than half: ``()``."""
    faster = (moved < 0.5 * desired) & (moved > 0.0)
    steps = faster.float() - (moved > 2.0 * desired).float()
    return (rate * torch.exp(math.log(1.5) * steps)).clamp(*LEARNING_RATE_RANGE)


class EstimatorBatch(NamedTuple):
    """What the estimator learns from, ``m`` samples."""

    history: torch.Tensor  # (m, H * 45)
    privileged: torch.Tensor  # body velocity 3, height 1, contacts 4 at the end of the history (m, 8)
    next_frame: torch.Tensor  # the frame one step later (m, 45)
    valid: torch.Tensor  # 1 where that frame belongs to the same episode (m,)
    noise: torch.Tensor  # standard normal (m, z)


def estimator_gradients(actor: Actor, batch: EstimatorBatch) -> tuple[list[torch.Tensor], torch.Tensor]:
    """Gradients of encoder and decoder; velocity-height, contact, reconstruction and latent losses ``(4,)``.

    Mean squared error on the scaled velocity and height, binary cross-entropy on the contacts, mean squared
    error of the decoded next frame where the episode goes on, and the divergence of the latent from a
    standard normal, a mean over samples like the others (a sum would drown them).
    """
    estimator, samples = actor.estimator, len(batch.history)
    encoding, encodings = estimator.recorded(actor.normalized_frames(batch.history))
    log_variance = encoding.log_variance.clamp(*LOG_VARIANCE_RANGE)
    variance, spread = log_variance.exp(), torch.exp(0.5 * log_variance) * batch.noise
    decoded, decodings = estimator.decoder.recorded(torch.cat((encoding.raw, encoding.mean + spread), 1))
    error = (decoded - actor.normalized_frames(batch.next_frame)) * actor.seen
    share = batch.valid[:, None] / (batch.valid.sum().clamp(min=1.0) * error.shape[1])
    of_decoder, back = estimator.decoder.gradients(decodings, 2.0 * share * error)
    by_raw, by_latent = estimator.decoder.input_gradient(back).split((ESTIMATE_SIZE, spread.shape[1]), 1)
    known, by_known = _known_losses(encoding.raw, actor.estimator.scaled_privileged(batch.privileged))
    weight = LATENT_WEIGHT / samples
    by_log_variance = 0.5 * (by_latent * spread + weight * (variance - 1.0))
    by_log_variance = torch.where(encoding.log_variance == log_variance, by_log_variance, 0.0)
    gradient = torch.cat((by_raw + by_known, by_latent + weight * encoding.mean, by_log_variance), 1)
    of_encoder, _ = estimator.encoder.gradients(encodings, gradient)
    latent = 0.5 * (encoding.mean.square() + variance - log_variance - 1.0).sum() / samples
    return [*of_encoder, *of_decoder], torch.stack((*known, (share * error.square()).sum(), latent))


def _known_losses(
    raw: torch.Tensor, wanted: torch.Tensor
) -> tuple[tuple[torch.Tensor, torch.Tensor], torch.Tensor]:
    """Velocity-height and contact loss ``()``, and their gradient by the raw estimate ``(m, 8)``."""
    error, logits = raw[:, :CONTACT_START] - wanted[:, :CONTACT_START], raw[:, CONTACT_START:]
    contact = wanted[:, CONTACT_START:]
    losses = error.square().mean(), functional.binary_cross_entropy_with_logits(logits, contact)
    by_state = error * (2.0 / error.numel())
    by_contact = (torch.sigmoid(logits) - contact) * (CONTACT_WEIGHT / logits.numel())
    return losses, torch.cat((by_state, by_contact), 1)
