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

_OTHER_LEG = (1, 0, 3, 2)
_JOINTS_PER_LEG = 3
_JOINT_SIGNS = (-1.0, 1.0, 1.0) * len(_OTHER_LEG)
_OTHER_JOINT = tuple(_JOINTS_PER_LEG * leg + joint for leg in _OTHER_LEG for joint in range(_JOINTS_PER_LEG))
_VECTOR_SIGNS, _ROTATION_SIGNS = (1.0, -1.0, 1.0), (-1.0, 1.0, -1.0)
_COMMAND_SIGNS = (1.0, -1.0, -1.0)
"""Forward speed, sideways speed, yaw rate."""

_Part = tuple[Sequence[int], Sequence[float]]
_ROTATION: _Part = (range(3), _ROTATION_SIGNS)
_VECTOR: _Part = (range(3), _VECTOR_SIGNS)
_COMMAND: _Part = (range(3), _COMMAND_SIGNS)
_JOINTS: _Part = (_OTHER_JOINT, _JOINT_SIGNS)
_HEIGHT: _Part = ((0,), (1.0,))
_CONTACTS: _Part = (_OTHER_LEG, (1.0,) * len(_OTHER_LEG))
_FRAME = (_ROTATION, _VECTOR, _COMMAND, _JOINTS, _JOINTS, _JOINTS)
"""Terms of ``ObservationLayout``, in their order."""
_ESTIMATE = (_VECTOR, _HEIGHT, _CONTACTS)


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
        history_length: frames in an observation.
        device: of the tensors to be reflected.

    Attributes:
        history: of an observation ``(..., H * 45)``.
        truth: of a frame with the body's velocity, height and contacts after it ``(..., 53)``.
        action: of an action ``(..., 12)``.
        spread: of deviations of an action's numbers ``(..., 12)``: these have no sign.
    """

    def __init__(self, history_length: int, device: str) -> None:
        self.history = Reflection(_FRAME * history_length, device)
        self.truth = Reflection((*_FRAME, *_ESTIMATE), device)
        self.action = Reflection((_JOINTS,), device)
        self.spread = Reflection(((_OTHER_JOINT, (1.0,) * len(_OTHER_JOINT)),), device)
