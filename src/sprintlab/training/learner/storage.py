"""The rollout: written in place, one row a robot: a block of robots is a mini-batch without a copy."""

from __future__ import annotations

import torch

from sprintlab.control import ESTIMATE_SIZE, Observation
from sprintlab.training.learner.losses import EstimatorBatch, PolicyBatch
from sprintlab.training.learner.networks import LATENT_SIZE
from sprintlab.training.settings import TrainingSettings


class Rollout:
    """``T`` transitions of ``n`` robots on one device; ``(n, T, ...)`` throughout.

    The column that is written is ``step``, a number on the device: writing can be captured in a graph.

    Attributes:
        noise_scale: factor of the action noise of each robot ``(n, T)``; not written by steps.
        end: 1 where an episode ended, the ended share of the future where a constraint was broken ``(n, T)``.
    """

    def __init__(
        self, robots: int, steps: int, observation: Observation, settings: TrainingSettings, device: str
    ) -> None:
        def zeros(*shape: int) -> torch.Tensor:
            return torch.zeros(robots, steps, *shape, device=device)

        self.robots, self.steps, self.frame_size = robots, steps, observation.frame_size
        joints, known = observation.joints, observation.frame_size + ESTIMATE_SIZE
        handedness = int(settings.ppo.symmetric)
        self.history = zeros(observation.input_size)
        self.actor_input = zeros(known + LATENT_SIZE + handedness)
        self.privileged = zeros(known + handedness)
        self.action, self.mean = zeros(joints), zeros(joints)
        self.next_frame = zeros(observation.frame_size)
        self.log_probability, self.value = zeros(), zeros()
        self.reward, self.end, self.time_out = zeros(), zeros(), zeros()
        self.advantage, self.returns = zeros(), zeros()
        self.noise_scale = torch.ones(robots, steps, device=device)
        self.step = torch.zeros(1, dtype=torch.long, device=device)

    def write(self, name: str, values: torch.Tensor) -> None:
        """Put ``values`` ``(n, ...)`` into the present column of a field."""
        getattr(self, name).index_copy_(1, self.step, values.unsqueeze(1))

    def policy_batch(self, first: int, last: int) -> PolicyBatch:
        """Transitions of the robots ``first`` to ``last``: views."""
        fields = {name: getattr(self, name) for name in PolicyBatch._fields}
        return PolicyBatch(**{name: field[first:last].flatten(0, 1) for name, field in fields.items()})

    def estimator_batch(self, first: int, last: int, noise: torch.Tensor) -> EstimatorBatch:
        """What the estimator learns from the robots ``first`` to ``last``: views, but for the mask."""
        estimate = slice(self.frame_size, self.frame_size + ESTIMATE_SIZE)
        return EstimatorBatch(
            history=self.history[first:last].flatten(0, 1),
            privileged=self.privileged[first:last].flatten(0, 1)[:, estimate],
            next_frame=self.next_frame[first:last].flatten(0, 1),
            valid=(self.end[first:last] < 1.0).flatten(0, 1).float(),
            noise=noise,
        )
