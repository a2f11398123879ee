"""The reward of a step: a run's terms with the weights of its stage, added up."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import torch

from sprintlab.training.environment.rewards import RewardInput
from sprintlab.training.terms import SPEED_HELD, YAW_RATE_HELD, RewardTerm

PENALTY_SCALE = 0.5
"""Factor of the penalties inside the exponential."""


class EarnedReward(NamedTuple):
    """What one step earns, per second."""

    paid: torch.Tensor  # sum of the rewards (n,)
    penalties: torch.Tensor  # sum of the penalties, not positive (n,)
    parts: torch.Tensor  # contribution of each term (n, terms)


class RewardTerms:
    """The terms of a run on a device.

    Attributes:
        weights: weights of the present stage ``(terms,)``.
        turning: whether what is tied is multiplied by how well the turn is held, too: 0 or 1.
    """

    def __init__(self, terms: Mapping[str, RewardTerm], device: str) -> None:
        self._terms = tuple(terms.values())
        self._tied = [name == SPEED_HELD or term.tied for name, term in terms.items()]
        self._speed, self._turn = (
            tuple(terms).index(name) if name in terms else None for name in (SPEED_HELD, YAW_RATE_HELD)
        )
        self._first, self._second = (
            torch.tensor([term.weights[stage] for term in self._terms], dtype=torch.float32, device=device)
            for stage in (0, 1)
        )
        self.weights = self._first.clone()
        self.turning = torch.zeros((), device=device)

    def set_stage(self, share: float, steady: bool = False) -> None:
        """Blend the weights: 0 in stage I, 1 in stage II; ``steady``: the fine-tuning phase has begun."""
        self.weights.copy_(torch.lerp(self._first, self._second, share))
        self.turning.fill_(float(steady))

    def values(self, x: RewardInput) -> torch.Tensor:
        """All terms, unweighted ``(n, terms)``.

        Infinities and NaN of a broken environment become zero: it ends, and must not poison the batch.
        """
        values = torch.stack([term.function(x, **term.parameters) for term in self._terms], 1)
        return torch.nan_to_num(values, nan=0.0, posinf=0.0, neginf=0.0)

    def earned(self, x: RewardInput) -> EarnedReward:
        """What the step earns."""
        values = self.values(x)
        held = self._held(values)
        parts = list((values * self.weights).unbind(1))
        if self._speed is not None:  # the factor of what is tied, itself as well
            parts[self._speed] = self.weights[self._speed].expand_as(held)
        places, nothing = range(len(parts)), torch.zeros_like(held)
        tied = _added([parts[k] for k in places if self._tied[k]], nothing)
        free = [parts[k] for k in places if self._terms[k].rewards and not self._tied[k]]
        penalties = [parts[k] for k in places if not self._terms[k].rewards]
        earned = [held * parts[k] if self._tied[k] else parts[k] for k in places]
        return EarnedReward(
            _added(free, nothing) + held * tied, _added(penalties, nothing), torch.stack(earned, 1)
        )

    def _held(self, values: torch.Tensor) -> torch.Tensor:
        """How well the command is held ``(n,)``: the speed; in the fine-tuning phase times the turn."""
        one = torch.ones_like(values[:, 0])
        speed = one if self._speed is None else values[:, self._speed]
        return speed if self._turn is None else speed * torch.lerp(one, values[:, self._turn], self.turning)


def _added(parts: Sequence[torch.Tensor], nothing: torch.Tensor) -> torch.Tensor:
    """Their sum, one after the other: the same bits whatever stands beside them."""
    return sum(parts[1:], parts[0]) if parts else nothing


def aggregate(paid: torch.Tensor, penalties: torch.Tensor, how: str) -> torch.Tensor:
    """Reward rate ``(n,)`` from both sums, ``"exponential"`` or ``"clipped"``.

    The first keeps a gradient where penalties are large and never rewards an early end.
    """
    if how == "exponential":
        return paid * torch.exp(PENALTY_SCALE * penalties.clamp(min=-20.0))
    return (paid + penalties).clamp(min=0.0)
