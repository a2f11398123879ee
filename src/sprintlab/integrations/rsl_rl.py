"""rsl_rl's learners on the training environment (extra ``rsl-rl``).

    from rsl_rl.runners import OnPolicyRunner
    from sprintlab.integrations.rsl_rl import RslRlEnvironment
    from sprintlab.training.environment.sprint import SprintEnvironment

    environment = RslRlEnvironment(SprintEnvironment(settings, "cuda:0"))
    OnPolicyRunner(environment, configuration, device="cuda:0").learn(100)

The environment writes over its buffers at each step, and rsl_rl's storage keeps what it is given until the
step is over: so it is given copies.
"""

from __future__ import annotations

from typing import Any, Protocol

import torch
from rsl_rl.env import VecEnv
from tensordict import TensorDict


class BatchEnvironment(Protocol):
    """What is adapted: ``sprintlab.training.environment.sprint.SprintEnvironment``, or something like it."""

    num_envs: int
    num_actions: int
    max_episode_length: int
    episode_length_buf: torch.Tensor
    device: str
    cfg: dict[str, Any]

    def get_observations(self) -> dict[str, torch.Tensor]:
        """Observations by group, each ``(n, size)``."""
        ...

    def step(
        self, actions: torch.Tensor
    ) -> tuple[dict[str, torch.Tensor], torch.Tensor, torch.Tensor, dict[str, torch.Tensor]]:
        """Observations, rewards ``(n,)``, reset mask ``(n,)`` and ``time_outs`` ``(n,)``."""
        ...


class RslRlEnvironment(VecEnv):
    """A training environment as rsl_rl's ``VecEnv``; whatever it hands out stays as it is.

    Args:
        environment: a training's. Its actor sees the observation history ``(n, 45 H)`` in the group
            ``actor``, its critic the privileged observation ``(n, 53)`` in the group ``critic``.

    Attributes:
        environment: as given.
    """

    def __init__(self, environment: BatchEnvironment) -> None:
        self.environment = environment
        self.num_envs, self.num_actions = environment.num_envs, environment.num_actions
        self.max_episode_length = environment.max_episode_length
        self.device, self.cfg = environment.device, environment.cfg

    @property
    def episode_length_buf(self) -> torch.Tensor:
        """Steps since each robot's last reset ``(n,)``; rsl_rl may draw them anew at its start."""
        return self.environment.episode_length_buf

    @episode_length_buf.setter
    def episode_length_buf(self, lengths: torch.Tensor) -> None:
        self.environment.episode_length_buf.copy_(lengths)

    def get_observations(self) -> TensorDict:
        """Copies of the present observations, by group."""
        return self._copied(self.environment.get_observations())

    def step(self, actions: torch.Tensor) -> tuple[TensorDict, torch.Tensor, torch.Tensor, dict[str, Any]]:
        """One policy step: observations, rewards ``(n,)``, reset mask ``(n,)``, and what else is known."""
        observations, rewards, done, extras = self.environment.step(actions)
        copies = {name: value.clone() for name, value in extras.items()}
        return self._copied(observations), rewards.clone(), done.clone(), copies

    def _copied(self, groups: dict[str, torch.Tensor]) -> TensorDict:
        copies = {name: value.clone() for name, value in groups.items()}
        return TensorDict(copies, batch_size=[self.num_envs], device=self.device)
