"""The networks: running normalization, the VAE estimator, actor and critic, symmetric or plain.

The estimator reads the normalized history and yields ``e`` (body velocity 3, height 1, foot contact 4) and a
latent ``z``; the actor sees the newest frame, the low-passed ``e`` and the mean of ``z``; the critic sees the
clean frame and the true ``e`` (DESIGN of the paper, section III).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import nn
from torch.nn import functional

from sprintlab.control import ESTIMATE_SIZE, Observation
from sprintlab.training.learner.equivariant import COLUMNS, LastLayer, SymmetricPerceptron, SymmetricTrunk
from sprintlab.training.learner.mirror import (
    ESTIMATE_MIRROR,
    HANDEDNESS_MIRROR,
    Mirror,
    frame_mirror,
    joint_mirror,
    paired,
    signed,
)
from sprintlab.training.settings import NORMALIZER_FLOOR, EstimatorSettings, PpoSettings, TrainingSettings

VELOCITY_SIZE, CONTACT_START = 3, 4
VELOCITY_SCALE, HEIGHT_SCALE = 0.5, 10.0
"""What the estimator learns is multiplied with, per m/s and per metre: unscaled, the squared error of 12 m/s
would drown all else."""
LARGEST_STD = 1.5
LARGEST_NORMALIZED = 10.0
_LOG_VARIANCE_RANGE = (-8.0, 4.0)


class FirstLinear(nn.Linear):
    """A first layer whose input is filled up with zeros to a multiple of eight numbers.

    The fast matrix kernels of a GPU read eight numbers of 16 bits at once; for 69 or 53 columns cuBLAS falls
    back to kernels of an older generation, on which an H200 spent 15 % of the update.
    """

    def __init__(self, inputs: int, outputs: int) -> None:
        self._fill = -inputs % COLUMNS
        super().__init__(inputs + self._fill, outputs)
        with torch.no_grad():
            self.weight[:, inputs:] = 0.0  # nothing ever reaches them, no gradient either

    def forward(self, input: torch.Tensor) -> torch.Tensor:
        """As ``torch.nn.Linear`` ``(..., inputs)``."""
        return functional.linear(functional.pad(input, (0, self._fill)), self.weight, self.bias)

    def trimmed(self) -> nn.Linear:
        """The same layer with as many columns as there are inputs."""
        layer = nn.Linear(self.in_features - self._fill, self.out_features)
        with torch.no_grad():
            layer.weight.copy_(self.weight[:, : layer.in_features])
            layer.bias.copy_(self.bias)
        return layer


def trim(network: nn.Module) -> None:
    """Replace every ``FirstLinear`` in a network by its ``trimmed`` layer, in place."""
    for module in list(network.modules()):
        for name, child in list(module.named_children()):
            if isinstance(child, FirstLinear):
                setattr(module, name, child.trimmed())


class LastLinear(nn.Linear):
    """A last layer: in single precision also where the layers before it are not.

    A value of 20 has steps of 0.1 in eight bits, and the reward of a policy step is a few hundredths.
    """

    def forward(self, input: torch.Tensor) -> torch.Tensor:
        """As ``torch.nn.Linear``, in single precision."""
        with torch.autocast(input.device.type, enabled=False):
            return functional.linear(input.float(), self.weight, self.bias)


def perceptron(sizes: Sequence[int]) -> nn.Sequential:
    """Linear layers of these widths with ELU between them; two widths are one layer, the last."""
    layers: list[nn.Module] = [FirstLinear(sizes[0], sizes[1]), nn.ELU()] if len(sizes) > 2 else []
    for narrow, wide in itertools.pairwise(sizes[1:-1]):
        layers += [nn.Linear(narrow, wide), nn.ELU()]
    return nn.Sequential(*layers, LastLinear(sizes[-2], sizes[-1]))


class Normalizer(nn.Module):
    """Subtracts the running mean and divides by the running deviation of each number ``(..., size)``.

    Args:
        size: of the vector.
        mirror: of the vector, if the statistics shall be those of the samples and their mirror images.
    """

    mean: torch.Tensor
    variance: torch.Tensor
    count: torch.Tensor
    index: torch.Tensor
    sign: torch.Tensor

    def __init__(self, size: int, mirror: Mirror | None = None) -> None:
        super().__init__()
        self.mirrored = mirror is not None
        if mirror is not None:
            self.register_buffer("index", torch.tensor(mirror.index), persistent=False)
            self.register_buffer("sign", torch.tensor(mirror.sign), persistent=False)
        self.register_buffer("mean", torch.zeros(size))
        self.register_buffer("variance", torch.ones(size))
        self.register_buffer("count", torch.zeros(()))

    def moments(self) -> list[torch.Tensor]:
        """What it has learned: mean and variance ``(size,)``, and the number of samples ``()``."""
        return [self.mean, self.variance, self.count]

    def forward(self, values: torch.Tensor) -> torch.Tensor:
        """Normalized values, limited to +-10 so that an outlier cannot saturate the networks."""
        scaled = (values - self.mean) / (self.variance.sqrt() + NORMALIZER_FLOOR)
        return scaled.clamp(-LARGEST_NORMALIZED, LARGEST_NORMALIZED)

    @torch.no_grad()
    def update(self, mean: torch.Tensor, variance: torch.Tensor, count: int) -> None:
        """Merge the moments of ``count`` further samples (Chan's rule); no host synchronisation."""
        if self.mirrored:
            mean, variance = self._with_mirror_images(mean, variance)
        total = self.count + count
        difference = mean - self.mean
        share = count / total
        spread = self.variance * (1 - share) + variance * share
        self.variance.copy_(spread + difference.square() * share * (1 - share))
        self.mean.add_(difference * share)
        self.count.copy_(total)

    def _with_mirror_images(
        self, mean: torch.Tensor, variance: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Moments of samples and their mirror images together, from those of the samples ``(size,)``."""
        other, spread = self.sign * mean[self.index], variance[self.index]
        return 0.5 * (mean + other), 0.5 * (variance + spread) + 0.25 * (mean - other).square()


class Encoding(NamedTuple):
    """What the encoder says of a history ``(n, ...)``.

    Attributes:
        raw: the estimate in training units: scaled velocity and height, contact logits ``(n, 8)``.
        mean: of the latent ``(n, z)``.
        log_variance: of the latent ``(n, z)``.
    """

    raw: torch.Tensor
    mean: torch.Tensor
    log_variance: torch.Tensor


class Estimator(nn.Module):
    """History to estimate and latent, and back to the next frame.

    Args:
        observation: what the robot sees.
        settings: widths and scales.
        height: of the trunk about which the height estimate is centred [m].
        symmetric: whether a mirrored history gives the mirrored estimate.
    """

    def __init__(
        self, observation: Observation, settings: EstimatorSettings, height: float, symmetric: bool = False
    ) -> None:
        super().__init__()
        self.settings, self._height = settings, height
        build = self._build_symmetric if symmetric else self._build_plain
        build(observation, settings)

    def _build_plain(self, observation: Observation, settings: EstimatorSettings) -> None:
        trunk, features = perceptron((observation.input_size, *settings.encoder)), settings.encoder[-1]
        self.encoder = nn.Sequential(trunk, nn.ELU())
        self.estimate_head = nn.Linear(features, ESTIMATE_SIZE)
        self.mean_head, self.log_variance_head = (nn.Linear(features, settings.latent) for _ in range(2))
        self.decoder = perceptron(
            (ESTIMATE_SIZE + settings.latent, *settings.decoder, observation.frame_size)
        )

    def _build_symmetric(self, observation: Observation, settings: EstimatorSettings) -> None:
        frame, latent, features = frame_mirror(observation), paired(settings.latent), settings.encoder[-1]
        history = Mirror((), ()).joined(*[frame] * observation.history_length)
        self.encoder = SymmetricTrunk(history, settings.encoder)
        self.estimate_head = LastLayer(features, ESTIMATE_MIRROR)
        self.mean_head, self.log_variance_head = (LastLayer(features, latent) for _ in range(2))
        self.decoder = SymmetricPerceptron(ESTIMATE_MIRROR.joined(latent), settings.decoder, frame)

    def forward(self, history: torch.Tensor) -> Encoding:
        """Encode normalized histories ``(n, H * 45)``."""
        features = self.encoder(history)
        log_variance = self.log_variance_head(features).clamp(*_LOG_VARIANCE_RANGE)
        return Encoding(self.estimate_head(features), self.mean_head(features), log_variance)

    def physical(self, raw: torch.Tensor) -> torch.Tensor:
        """The estimate in SI units: velocity [m/s], height [m], contact probability ``(n, 8)``."""
        velocity = raw[:, :VELOCITY_SIZE] / VELOCITY_SCALE
        height = raw[:, VELOCITY_SIZE:CONTACT_START] / HEIGHT_SCALE + self._height
        return torch.cat((velocity, height, torch.sigmoid(raw[:, CONTACT_START:])), 1)

    def scaled_privileged(self, privileged: torch.Tensor) -> torch.Tensor:
        """True velocity and height in training units ``(n, 4)``, from ``(n, 8)``."""
        velocity = privileged[:, :VELOCITY_SIZE] * VELOCITY_SCALE
        height = (privileged[:, VELOCITY_SIZE:CONTACT_START] - self._height) * HEIGHT_SCALE
        return torch.cat((velocity, height), 1)

    def decode(self, encoding: Encoding, noise: torch.Tensor) -> torch.Tensor:
        """The next normalized frame ``(n, 45)``, from a latent sampled with ``noise`` ``(n, z)``."""
        latent = encoding.mean + torch.exp(0.5 * encoding.log_variance) * noise
        return self.decoder(torch.cat((encoding.raw, latent), 1))


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
        self.normalizer = Normalizer(known.size, known if self.symmetric else None)
        self.estimator = Estimator(observation, estimator, height, self.symmetric)
        if self.symmetric:
            inward = known.joined(paired(estimator.latent), HANDEDNESS_MIRROR)
            self.policy = SymmetricPerceptron(inward, ppo.hidden, joint_mirror(joints))
        else:
            self.policy = perceptron((known.size + estimator.latent, *ppo.hidden, joints))
        self.std = nn.Parameter(torch.full((joints,), ppo.initial_std))
        seen = torch.ones(self.frame_size)
        if not estimator.sees_command:
            seen[observation.place("command")] = 0.0
        self.register_buffer("seen", seen, persistent=False)

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

    def decide(self, actor_input: torch.Tensor) -> torch.Tensor:
        """Mean action ``(n, joints)`` from the policy network's input ``(n, 70)``."""
        known = self.frame_size + ESTIMATE_SIZE
        return self.policy(torch.cat((self.normalizer(actor_input[:, :known]), actor_input[:, known:]), 1))

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
        self._known = known.size
        self.normalizer = Normalizer(known.size, known if settings.symmetric else None)
        if settings.symmetric:
            self.value = SymmetricPerceptron(known.joined(HANDEDNESS_MIRROR), settings.hidden, signed(1.0))
        else:
            self.value = perceptron((known.size, *settings.hidden, 1))

    def forward(self, privileged: torch.Tensor) -> torch.Tensor:
        """Value ``(n,)`` of what the critic sees ``(n, 54)``; ``(n, 53)`` where it is not symmetric."""
        known = self.normalizer(privileged[:, : self._known])
        return self.value(torch.cat((known, privileged[:, self._known :]), 1))[:, 0]
