"""The mirror image of what a robot sees and does: left and right exchanged.

A walking robot has a plane of symmetry, and so has its task: what is right in a state is right, mirrored, in
the mirrored state. A rollout thus holds a second one that costs no physics (Mittal et al. 2024, "Symmetry
considerations for learning task symmetric robot policies", data augmentation).

Legs come in the order front left, front right, rear left, rear right, joints in the order abduction, hip,
knee; x points forward, y to the left, z up.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch

from sprintlab.control import OBSERVATION_TERMS, Observation
from sprintlab.robots import RobotDescription, mirror_joints, mirror_legs

_VECTOR_SIGNS = (1.0, -1.0, 1.0)
_Part = tuple[Sequence[int], Sequence[float]]


class Reflection:
    """Numbers in another order, some with the other sign."""

    def __init__(self, parts: Sequence[_Part], device: str) -> None:
        order: list[int] = []
        signs: list[float] = []
        for indices, part_signs in parts:
            start = len(order)
            order += [start + index for index in indices]
            signs += part_signs
        self._order = torch.tensor(order, device=device)
        self._signs = torch.tensor(signs, device=device)

    def __call__(self, values: torch.Tensor) -> torch.Tensor:
        """The mirror image of ``(..., size)``."""
        return values[..., self._order] * self._signs

    def symmetric_moments(
        self, mean: torch.Tensor, variance: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Mean and variance ``(size,)`` of samples and their mirror images together."""
        difference = 0.5 * (mean - self(mean))
        return mean - difference, 0.5 * (variance + variance[self._order]) + difference.square()


class Mirror:
    """Reflections of everything that a rollout holds.

    Args:
        observation: what the robot sees.
        robot: whose joints and legs have a partner on the other side.
        device: of the tensors to be reflected.

    Attributes:
        history: of an observation ``(..., H * F)``.
        privileged: of a frame with the body's velocity, height and contacts after it ``(..., F + 8)``.
        action: of an action ``(..., joints)``.
    """

    def __init__(self, observation: Observation, robot: RobotDescription, device: str) -> None:
        joints = mirror_joints(robot)
        frame: tuple[_Part, ...] = tuple(
            joints if term.mirror is None else (range(len(term.mirror)), term.mirror)
            for term in OBSERVATION_TERMS
        )
        legs = mirror_legs(robot)
        estimate: tuple[_Part, ...] = ((range(3), _VECTOR_SIGNS), ((0,), (1.0,)), (legs, (1.0,) * len(legs)))
        self.history = Reflection(frame * observation.history_length, device)
        self.privileged = Reflection((*frame, *estimate), device)
        self.action = Reflection((joints,), device)
