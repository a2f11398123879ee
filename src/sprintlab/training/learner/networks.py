"""The networks: running normalization, the VAE estimator, actor and critic, symmetric or plain.

The estimator reads the normalized history and yields ``e`` (body velocity 3, height 1, foot contact 4) and a
latent ``z``; the actor sees the newest frame, the low-passed ``e`` and the mean of ``z``; the critic sees the
clean frame and the true ``e`` (DESIGN of the paper, section III).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import nn

from sprintlab.control import ESTIMATE_SIZE, Observation
from sprintlab.training.learner.mirror import (
    ESTIMATE_MIRROR,
    HANDEDNESS_MIRROR,
    Basis,
    Mirror,
    frame_mirror,
    joint_mirror,
    paired,
    signed,
)
from sprintlab.training.learner.perceptron import Perceptron, Tape
from sprintlab.training.settings import NORMALIZER_FLOOR, EstimatorSettings, PpoSettings, TrainingSettings

VELOCITY_SIZE, CONTACT_START = 3, 4
VELOCITY_SCALE, HEIGHT_SCALE = 0.5, 10.0
"""What the estimator learns is multiplied with, per m/s and per metre: unscaled, the squared error of 12 m/s
would drown all else."""
LATENT_SIZE = 16
"""Size of ``z``, the paper's."""
DECODER = (64, 128)
"""Widths of the decoder's layers, after DreamWaQ's open implementations."""
INITIAL_STD, LARGEST_STD = 0.8, 1.5
"""Standard deviation of the action noise at the start of a run, and its limit in any."""
LARGEST_NORMALIZED = 10.0
LOG_VARIANCE_RANGE = (-8.0, 4.0)


class Normalizer(nn.Module):
    """Subtracts the running mean and divides by the running deviation of each number ``(..., size)``.

    Args:
        mirror: mirror image of the vector, if mirror images of the samples shall count as well.
        others: numbers behind the vector that are not normalized.
    """

    mean: torch.Tensor
    variance: torch.Tensor
    count: torch.Tensor
    index: torch.Tensor
    sign: torch.Tensor
    beyond: torch.Tensor
    limit: torch.Tensor

    def __init__(self, size: int, mirror: Mirror | None = None, others: int = 0) -> None:
        super().__init__()
        index, sign = mirror or signed(*(1.0,) * size)
        self.register_buffer("index", torch.tensor(index), persistent=False)
        self.register_buffer("sign", torch.tensor(sign), persistent=False)
        self.register_buffer("beyond", torch.zeros(others), persistent=False)
        limit = torch.cat((torch.full((size,), LARGEST_NORMALIZED), torch.full((others,), math.inf)))
        self.register_buffer("limit", limit, persistent=False)
        self.register_buffer("mean", torch.zeros(size))
        self.register_buffer("variance", torch.ones(size))
        self.register_buffer("count", torch.zeros(()))

    def moments(self) -> list[torch.Tensor]:
        """What it has learned: mean and variance ``(size,)``, and the number of samples ``()``."""
        return [self.mean, self.variance, self.count]

    def forward(self, values: torch.Tensor) -> torch.Tensor:
        """Normalized values, limited to +-10 so that an outlier cannot saturate the networks.

        Numbers beyond its size stay as they are ``(n, size + others)``.
        """
        mean = torch.cat((self.mean, self.beyond))
        scale = torch.cat((self.variance.sqrt() + NORMALIZER_FLOOR, self.beyond + 1.0))
        return ((values - mean) / scale).clamp(-self.limit, self.limit)

    @torch.no_grad()
    def update(self, mean: torch.Tensor, variance: torch.Tensor, count: int) -> None:
        """Merge the moments of ``count`` further samples (Chan's rule) and of their mirror images.

        No host synchronisation.
        """
        other, spread = self.sign * mean[self.index], variance[self.index]
        variance = 0.5 * (variance + spread) + 0.25 * (mean - other).square()
        mean = 0.5 * (mean + other)
        total = self.count + count
        difference = mean - self.mean
        share = count / total
        spread = self.variance * (1 - share) + variance * share
        self.variance.copy_(spread + difference.square() * share * (1 - share))
        self.mean.add_(difference * share)
        self.count.copy_(total)


class Encoding(NamedTuple):
    """What the encoder says of a history ``(n, ...)``."""

    raw: torch.Tensor  # the estimate in training units: scaled velocity and height, contact logits (n, 8)
    mean: torch.Tensor  # mean of the latent (n, z)
    log_variance: torch.Tensor  # log variance of the latent, before it is limited (n, z)


class Estimator(nn.Module):
    """History to estimate and latent, and back to the next frame.

    Args:
        height: trunk height about which the height estimate is centred [m].
        symmetric: whether a mirrored history gives the mirrored estimate.
    """

    def __init__(
        self, observation: Observation, settings: EstimatorSettings, height: float, symmetric: bool = False
    ) -> None:
        super().__init__()
        self._height, self._sizes = height, (ESTIMATE_SIZE, LATENT_SIZE, LATENT_SIZE)

        def basis(*mirrors: Mirror) -> Basis:
            return _basis(symmetric, *mirrors)

        frame, latent = frame_mirror(observation), paired(LATENT_SIZE)
        history, encoding = [frame] * observation.history_length, (ESTIMATE_MIRROR, latent, latent)
        self.encoder = Perceptron(basis(*history), settings.encoder, basis(*encoding))
        self.decoder = Perceptron(basis(ESTIMATE_MIRROR, latent), DECODER, basis(frame))

    def forward(self, history: torch.Tensor) -> Encoding:
        """Encode normalized histories ``(n, H * 45)``."""
        return self.recorded(history)[0]

    def recorded(self, history: torch.Tensor) -> tuple[Encoding, Tape]:
        """The encoding, and what the encoder's ``gradients`` needs."""
        output, tape = self.encoder.recorded(history)
        return Encoding(*output.split(self._sizes, 1)), tape

    def physical(self, raw: torch.Tensor) -> torch.Tensor:
        """The estimate in SI units: velocity [m/s], height [m], contact probability ``(n, 8)``."""
        velocity = raw[:, :VELOCITY_SIZE] / VELOCITY_SCALE
        height = raw[:, VELOCITY_SIZE:CONTACT_START] / HEIGHT_SCALE + self._height
        return torch.cat((velocity, height, torch.sigmoid(raw[:, CONTACT_START:])), 1)

    def scaled_privileged(self, privileged: torch.Tensor) -> torch.Tensor:
        """True velocity, height and contacts in training units ``(n, 8)``, from those in SI units."""
        velocity = privileged[:, :VELOCITY_SIZE] * VELOCITY_SCALE
        height = (privileged[:, VELOCITY_SIZE:CONTACT_START] - self._height) * HEIGHT_SCALE
        return torch.cat((velocity, height, privileged[:, CONTACT_START:]), 1)


class Actor(nn.Module):
    """Everything that runs on the robot: normalization, estimator, low-pass on the estimate, policy.

    A symmetric actor on a symmetric robot in a symmetric world could only bound: handedness, a number of +1
    or -1 that the mirror turns around, breaks the tie. It is drawn per episode in training, +1 on the robot.
    """

    seen: torch.Tensor

    def __init__(self, settings: TrainingSettings, joints: int, height: float, coefficient: float) -> None:
        super().__init__()
        ppo, estimator = settings.ppo, settings.estimator
        observation = settings.observation.for_joints(joints)
        self.history_length, self._coefficient = observation.history_length, coefficient
        self.frame_size = observation.frame_size
        self.symmetric = ppo.symmetric
        known = frame_mirror(observation).joined(ESTIMATE_MIRROR)
        handedness = _handedness(self.symmetric)
        others = LATENT_SIZE + len(handedness)
        self.normalizer = Normalizer(known.size, known if self.symmetric else None, others)
        self.estimator = Estimator(observation, estimator, height, self.symmetric)
        seen = (known, paired(LATENT_SIZE), *handedness)
        self.policy = Perceptron(
            _basis(self.symmetric, *seen), ppo.hidden, _basis(self.symmetric, joint_mirror(joints))
        )
        self.std = nn.Parameter(torch.full((joints,), INITIAL_STD))
        self.register_buffer("seen", torch.ones(self.frame_size), persistent=False)
        self.seen[observation.place("command")] = 0.0

    def normalized_frames(self, frames: torch.Tensor) -> torch.Tensor:
        """Frames ``(n, k * 45)`` as the estimator sees them: normalized with the statistics of one frame."""
        count = frames.shape[1] // self.frame_size
        mean = self.normalizer.mean[: self.frame_size].repeat(count)
        scale = (self.normalizer.variance[: self.frame_size].sqrt() + NORMALIZER_FLOOR).repeat(count)
        values = ((frames - mean) / scale).clamp(-LARGEST_NORMALIZED, LARGEST_NORMALIZED)
        return values * self.seen.repeat(count)

    def perceive(
        self, history: torch.Tensor, previous: torch.Tensor, handedness: torch.Tensor | None = None
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """What the policy network sees, not normalized ``(n, 70)``, and the filtered estimate ``(n, 8)``.

        Args:
            history: ``(n, H * 45)``, oldest frame first.
            previous: the filtered estimate of the step before; zeros at a start ``(n, 8)``.
            handedness: +1 or -1 ``(n, 1)``, of a symmetric actor; +1 when left out.
        """
        encoding = self.estimator(self.normalized_frames(history))
        value = self.estimator.physical(encoding.raw)
        estimate = previous + self._coefficient * (value - previous)
        seen = [history[:, -self.frame_size :], estimate, encoding.mean]
        if self.symmetric:
            seen.append(torch.ones_like(estimate[:, :1]) if handedness is None else handedness)
        return torch.cat(seen, 1), estimate

    def decide(self, actor_input: torch.Tensor, precision: torch.dtype = torch.float32) -> torch.Tensor:
        """Mean action ``(n, joints)`` from the policy network's input ``(n, 70)``."""
        return self.policy(self.normalizer(actor_input), precision)

    def forward(
        self, observation: torch.Tensor, previous_estimate: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Mean action and filtered estimate: the graph that is exported."""
        actor_input, estimate = self.perceive(observation, previous_estimate)
        return self.decide(actor_input), estimate


class Critic(nn.Module):
    """Value of a state from the clean frame, the true body velocity, height and contacts, and handedness."""

    def __init__(self, settings: PpoSettings, observation: Observation) -> None:
        super().__init__()
        known = frame_mirror(observation).joined(ESTIMATE_MIRROR)
        handedness = _handedness(settings.symmetric)
        self.normalizer = Normalizer(known.size, known if settings.symmetric else None, len(handedness))
        seen = (known, *handedness)
        self.value = Perceptron(
            _basis(settings.symmetric, *seen), settings.hidden, _basis(settings.symmetric, signed(1.0))
        )

    def forward(self, privileged: torch.Tensor, precision: torch.dtype = torch.float32) -> torch.Tensor:
        """Value ``(n,)`` of what the critic sees ``(n, 54)``; ``(n, 53)`` where it is not symmetric."""
        return self.value(self.normalizer(privileged), precision)[:, 0]


def _handedness(symmetric: bool) -> tuple[Mirror, ...]:
    return (HANDEDNESS_MIRROR,) if symmetric else ()


def _basis(symmetric: bool, *mirrors: Mirror) -> Basis:
    """The basis of a vector of several parts."""
    mirror = Mirror((), ()).joined(*mirrors)
    return Basis(mirror.size, mirror if symmetric else None)
