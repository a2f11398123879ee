"""What mirroring left and right does to the vectors that networks read and write.

Every robot here is built from left legs that the right ones mirror, so the mirror image of a vector is a
signed permutation of it: ``mirrored[i] = sign[i] * vector[index[i]]``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import torch

from sprintlab.control import OBSERVABLES, Observation

_OTHER_SIDE = (1, 0, 3, 2)
"""Leg on the other side of each of FL, FR, RL, RR."""
_JOINT_SIGNS = (-1.0, 1.0, 1.0)
"""Of abduction, hip and knee: abduction turns about the forward axis, the others about the lateral one."""


class Mirror(NamedTuple):
    """A signed permutation ``(size,)`` that is its own inverse.

    Attributes:
        index: where each number of the mirror image comes from.
        sign: its factor, +1 or -1.
    """

    index: tuple[int, ...]
    sign: tuple[float, ...]

    @property
    def size(self) -> int:
        """Numbers of the vector."""
        return len(self.index)

    def joined(self, *others: Mirror) -> Mirror:
        """The mirror of this vector followed by others."""
        index, sign = list(self.index), list(self.sign)
        for other in others:
            index += [len(index) + place for place in other.index]
            sign += other.sign
        return Mirror(tuple(index), tuple(sign))

    def of(self, vectors: torch.Tensor) -> torch.Tensor:
        """Mirror images of vectors ``(..., size)``."""
        return vectors[..., list(self.index)] * vectors.new_tensor(self.sign)


def signed(*signs: float) -> Mirror:
    """Numbers that stay where they are."""
    return Mirror(tuple(range(len(signs))), signs)


def paired(size: int) -> Mirror:
    """Channels of which the second half mirrors the first."""
    half = size // 2
    return Mirror((*range(half, size), *range(half)), (1.0,) * size)


def legs_mirror(signs: Sequence[float]) -> Mirror:
    """Numbers of each leg one after the other, with the sign of each kind."""
    kinds = len(signs)
    index = tuple(kinds * leg + kind for leg in _OTHER_SIDE for kind in range(kinds))
    return Mirror(index, tuple(signs) * len(_OTHER_SIDE))


def joint_mirror(joints: int) -> Mirror:
    """Of the joints in policy order; a waist, which pitches, comes last and keeps its sign."""
    legs = legs_mirror(_JOINT_SIGNS)
    return legs.joined(signed(*(1.0,) * (joints - legs.size)))


def frame_mirror(observation: Observation) -> Mirror:
    """Of one frame of the observation."""
    signs = (OBSERVABLES[name].mirror for name in observation.layout.terms)
    terms = (joint_mirror(observation.joints) if each is None else signed(*each) for each in signs)
    return Mirror((), ()).joined(*terms)


ESTIMATE_MIRROR = signed(1.0, -1.0, 1.0, 1.0).joined(legs_mirror((1.0,)))
"""Of body velocity 3, height and the contact of each foot."""
HANDEDNESS_MIRROR = signed(-1.0)
"""Of the number that breaks the tie between the two mirror images of a gait."""
