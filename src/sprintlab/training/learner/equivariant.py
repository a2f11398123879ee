"""Networks that are exactly symmetric left and right: the mirrored input gives the mirrored output.

Hidden channels come in pairs ``(u, v)`` that the mirror exchanges. A linear map that commutes with the mirror
is diagonal in sums and differences of the pairs,

    s = (u + v) / sqrt 2,  d = (u - v) / sqrt 2,      s' = A s + b,  d' = B d,

which is half the arithmetic of a dense layer of the same width. Activations are kept as
``(2, n, width / 2)``: ``s`` first, then ``d``, so that a layer is one batched product. The mirror of inputs
and outputs, a signed permutation, is folded into the weights of the first and the last layer.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import torch
from torch import nn
from torch.nn import functional

from sprintlab.core.errors import InvalidValueError
from sprintlab.training.learner.mirror import Mirror

_COLUMNS = 8
"""Inputs are filled up with zeros to a multiple of this: the fast matrix kernels of a GPU read eight numbers
of 16 bits at once."""


class _Folded(nn.Module):
    """Free weights of one channel of each pair; those of the other follow by the mirror.

    Args:
        weight: ``(size, pairs)``.
        mirror: of the vector of ``size`` numbers.
    """

    index: torch.Tensor
    sign: torch.Tensor

    def __init__(self, weight: torch.Tensor, mirror: Mirror) -> None:
        super().__init__()
        self.weight = nn.Parameter(weight)
        self.register_buffer("index", torch.tensor(mirror.index), persistent=False)
        self.register_buffer("sign", torch.tensor(mirror.sign)[:, None], persistent=False)

    def folded(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Weights between the vector and sums, and differences, of the pairs ``(size, pairs)`` each."""
        other = self.sign * self.weight.index_select(0, self.index)
        return self.weight + other, self.weight - other


class FirstLayer(_Folded):
    """From a vector ``(n, size)`` to sums and differences before the activation."""

    def __init__(self, mirror: Mirror, width: int) -> None:
        size, pairs = mirror.size, _pairs(width)
        super().__init__(_uniform(size, pairs, 1.0 / math.sqrt(size)), mirror)
        self.bias = nn.Parameter(_uniform(pairs, 1, 1.0 / math.sqrt(size))[:, 0])
        self._fill = -size % _COLUMNS

    def forward(self, vector: torch.Tensor) -> Sequence[torch.Tensor]:
        """Sums and differences ``(n, width / 2)`` each, from one product."""
        with torch.autocast(vector.device.type, enabled=False):
            weight = math.sqrt(0.5) * torch.cat(self.folded(), 1)
        if vector.is_cuda and self._fill:
            vector = functional.pad(vector, (0, self._fill))
            weight = functional.pad(weight, (0, 0, 0, self._fill))
        return torch.matmul(vector, weight).chunk(2, 1)


class PairLayer(nn.Module):
    """From sums and differences to sums and differences, before the activation."""

    def __init__(self, narrow: int, width: int) -> None:
        super().__init__()
        inputs, outputs = _pairs(narrow), _pairs(width)
        bound = 1.0 / math.sqrt(inputs)
        self.weight = nn.Parameter(_uniform(2 * inputs, outputs, bound).view(2, inputs, outputs))
        self.bias = nn.Parameter(_uniform(outputs, 1, bound)[:, 0])

    def forward(self, pairs: torch.Tensor) -> torch.Tensor:
        """``(2, n, width / 2)`` from ``(2, n, narrow / 2)``."""
        return torch.matmul(pairs, self.weight)


class LastLayer(_Folded):
    """From sums and differences to a vector with a mirror of its own, in single precision.

    Single precision also where the layers before it have less: a value of 20 has steps of 0.1 in eight bits,
    and the reward of a policy step is a few hundredths.
    """

    def __init__(self, width: int, mirror: Mirror) -> None:
        bound = 1.0 / math.sqrt(width)
        super().__init__(_uniform(mirror.size, _pairs(width), bound), mirror)
        self.bias = nn.Parameter(_uniform(mirror.size, 1, bound)[:, 0])

    def forward(self, pairs: torch.Tensor) -> torch.Tensor:
        """The vector ``(n, size)``."""
        with torch.autocast(pairs.device.type, enabled=False):
            sums, differences = self.folded()
            bias = 0.5 * (self.bias + self.sign[:, 0] * self.bias.index_select(0, self.index))
            pairs = math.sqrt(0.5) * pairs.float()
            return functional.linear(pairs[0], sums, bias) + functional.linear(pairs[1], differences)


class SymmetricTrunk(nn.Module):
    """Hidden layers with ELU: a vector ``(n, size)`` to sums and differences ``(2, n, widths[-1] / 2)``.

    Raises:
        InvalidValueError: a width that is odd.
    """

    def __init__(self, mirror: Mirror, widths: Sequence[int]) -> None:
        super().__init__()
        layers = [PairLayer(narrow, width) for narrow, width in itertools.pairwise(widths)]
        self.layers = nn.ModuleList([FirstLayer(mirror, widths[0]), *layers])

    def forward(self, vector: torch.Tensor) -> torch.Tensor:
        """``(2, n, widths[-1] / 2)``."""
        for layer in self.layers:
            vector = _activated(layer(vector), layer.bias)  # pyright: ignore[reportArgumentType]
        return vector


class SymmetricPerceptron(nn.Module):
    """A vector with one mirror to a vector with another, through hidden layers of these widths."""

    def __init__(self, inward: Mirror, widths: Sequence[int], outward: Mirror) -> None:
        super().__init__()
        self.trunk, self.last = SymmetricTrunk(inward, widths), LastLayer(widths[-1], outward)

    def forward(self, vector: torch.Tensor) -> torch.Tensor:
        """``(n, outward.size)``."""
        return self.last(self.trunk(vector))


def _activated(pairs: Sequence[torch.Tensor] | torch.Tensor, bias: torch.Tensor) -> torch.Tensor:
    """ELU of each channel, in sums and differences."""
    s, d = pairs[0] + bias, pairs[1]
    u, v = functional.elu(math.sqrt(0.5) * (s + d)), functional.elu(math.sqrt(0.5) * (s - d))
    return math.sqrt(0.5) * torch.stack((u + v, u - v))


def _pairs(width: int) -> int:
    if width % 2:
        raise InvalidValueError("width of a symmetric layer", width, "an even number")
    return width // 2


def _uniform(rows: int, columns: int, bound: float) -> torch.Tensor:
    return (2.0 * torch.rand(rows, columns) - 1.0) * bound
