"""What mirroring left and right does to the vectors that networks read and write.

Every robot here is built from left legs that the right ones mirror, so the mirror image of a vector is a
signed permutation of it: ``mirrored[i] = sign[i] * vector[index[i]]``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import nn

from sprintlab.control import OBSERVABLES, Observation

_OTHER_SIDE = (1, 0, 3, 2)
"""Leg on the other side of each of FL, FR, RL, RR."""
_JOINT_SIGNS = (-1.0, 1.0, 1.0)
"""Signs of abduction, hip and knee: abduction turns about the forward axis, the others laterally."""
_COLUMNS = 8
"""Columns of a matrix are a multiple of this: the fast matrix kernels of a GPU read eight numbers of 16 bits
at once."""


class Mirror(NamedTuple):
    """A signed permutation ``(size,)`` that is its own inverse."""

    index: tuple[int, ...]  # where each number of the mirror image comes from
    sign: tuple[float, ...]  # its factor, +1 or -1

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
    """Mirror image of the joints in policy order; a waist, which pitches, comes last and keeps its sign."""
    legs = legs_mirror(_JOINT_SIGNS)
    return legs.joined(signed(*(1.0,) * (joints - legs.size)))


def frame_mirror(observation: Observation) -> Mirror:
    """Mirror image of one frame of the observation."""
    signs = (OBSERVABLES[name].mirror for name in observation.layout.terms)
    terms = (joint_mirror(observation.joints) if each is None else signed(*each) for each in signs)
    return Mirror((), ()).joined(*terms)


ESTIMATE_MIRROR = signed(1.0, -1.0, 1.0, 1.0).joined(legs_mirror((1.0,)))
"""Mirror image of body velocity 3, height and the contact of each foot."""
HANDEDNESS_MIRROR = signed(-1.0)
"""Mirror image of the number that breaks the tie between the two mirror images of a gait."""


class Basis(nn.Module):
    """Coordinates of a vector in which a mirror keeps some numbers and turns the sign of the others.

    Mirrored numbers ``x_i`` and ``x_j = sign * x_i`` become their sum and their difference, over sqrt 2: the
    map is orthogonal, its transpose its inverse. Both halves are filled up with zeros to the same number of
    columns. Without a mirror there is one half, the vector itself.

    Attributes:
        halves: 2, or 1 without a mirror.
        columns: columns of each half.
        pairs: columns of sums, and of their differences, which come first in their halves.
        matrix: the map ``(halves * columns, size)``.
    """

    into: torch.Tensor
    into_sign: torch.Tensor
    into_scale: torch.Tensor
    back: torch.Tensor
    back_sign: torch.Tensor
    back_scale: torch.Tensor

    def __init__(self, size: int, mirror: Mirror | None) -> None:
        super().__init__()
        self.size, self.halves = size, 1 if mirror is None else 2
        index, sign = mirror or Mirror(tuple(range(size)), (1.0,) * size)
        first = [place for place in range(size) if place < index[place]]
        kept, turned = ([i for i in range(size) if index[i] == i and sign[i] == s] for s in (1.0, -1.0))
        self.pairs, most = len(first), len(first) + max(len(kept), len(turned))
        self.columns = -(-most // _COLUMNS) * _COLUMNS
        matrix = torch.zeros(self.halves, self.columns, size)
        for column, place in enumerate(first):
            matrix[:, column, place] = math.sqrt(0.5)
            matrix[:, column, index[place]] = math.sqrt(0.5) * sign[place] * torch.tensor((1.0, -1.0))
        for half, places in enumerate((kept, turned)[: self.halves]):
            for column, place in enumerate(places):
                matrix[half, self.pairs + column, place] = 1.0
        self.matrix = matrix.flatten(0, 1)
        for name, rows in (("into", self.matrix), ("back", self.matrix.T)):
            rows = torch.cat((rows, torch.zeros_like(rows)), 1)  # two numbers at least
            scale, places = rows.abs().topk(2, 1)
            signs = rows.gather(1, places).sign()
            self.register_buffer(name, (places % (rows.shape[1] // 2)).T.contiguous(), persistent=False)
            self.register_buffer(f"{name}_sign", signs.T.contiguous(), persistent=False)
            self.register_buffer(f"{name}_scale", scale[:, 0].contiguous(), persistent=False)

    def forward(self, vector: torch.Tensor) -> torch.Tensor:
        """Both halves ``(halves, n, columns)`` of vectors ``(n, size)``."""
        flat = _two_terms(vector, self.into, self.into_sign, self.into_scale)
        return flat.view(-1, self.halves, self.columns).transpose(0, 1).contiguous()

    def inverse(self, halves: Sequence[torch.Tensor]) -> torch.Tensor:
        """The vectors ``(n, size)`` of halves ``(n, columns)``."""
        return _two_terms(torch.cat(list(halves), 1), self.back, self.back_sign, self.back_scale)


def _two_terms(
    vector: torch.Tensor, index: torch.Tensor, sign: torch.Tensor, scale: torch.Tensor
) -> torch.Tensor:
    """Scaled sums of two numbers of each vector ``(n, size)``, with signs: ``(n, len(scale))``."""
    one, other = (vector.index_select(1, index[term]) * sign[term] for term in range(2))
    return (one + other) * scale
