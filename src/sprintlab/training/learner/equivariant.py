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
from typing import Any

import torch
from torch import nn
from torch.nn import functional

from sprintlab.core.errors import InvalidValueError
from sprintlab.training.learner.mirror import Mirror

COLUMNS = 8
"""Inputs are filled up with zeros to a multiple of this: the fast matrix kernels of a GPU read eight numbers
of 16 bits at once."""
_PARTS = 32
"""Parts of the samples over which the gradient of a weight is summed apart on a GPU."""


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

    beside = True

    def __init__(self, mirror: Mirror, width: int) -> None:
        size, pairs = mirror.size, _pairs(width)
        super().__init__(_uniform(size, pairs, 1.0 / math.sqrt(size)), mirror)
        self.bias = nn.Parameter(_uniform(pairs, 1, 1.0 / math.sqrt(size))[:, 0])
        self._fill = -size % COLUMNS

    def forward(self, vector: torch.Tensor, precision: torch.dtype) -> torch.Tensor:
        """Sums and differences side by side ``(1, n, width)``, from one product."""
        weight = math.sqrt(0.5) * torch.cat(self.folded(), 1)
        if vector.is_cuda and self._fill:
            vector = functional.pad(vector, (0, self._fill))
            weight = functional.pad(weight, (0, 0, 0, self._fill))
        return product(vector.to(precision)[None], weight.to(precision)[None])


class PairLayer(nn.Module):
    """From sums and differences to sums and differences, before the activation."""

    beside = False

    def __init__(self, narrow: int, width: int) -> None:
        super().__init__()
        inputs, outputs = _pairs(narrow), _pairs(width)
        bound = 1.0 / math.sqrt(inputs)
        self.weight = nn.Parameter(_uniform(2 * inputs, outputs, bound).view(2, inputs, outputs))
        self.bias = nn.Parameter(_uniform(outputs, 1, bound)[:, 0])

    def forward(self, pairs: torch.Tensor, precision: torch.dtype) -> torch.Tensor:
        """``(2, n, width / 2)`` from ``(2, n, narrow / 2)``."""
        return product(pairs.to(precision), self.weight.to(precision))


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
            weight = math.sqrt(0.5) * torch.stack(self.folded()).transpose(1, 2)
            bias = 0.5 * (self.bias + self.sign[:, 0] * self.bias.index_select(0, self.index))
            return product(pairs.float(), weight).sum(0) + bias


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
        """``(2, n, widths[-1] / 2)``, in the precision of ``torch.autocast`` inside of it."""
        kind = vector.device.type
        precision = torch.get_autocast_dtype(kind) if torch.is_autocast_enabled(kind) else vector.dtype
        with torch.autocast(kind, enabled=False):
            for layer in self.layers:
                vector = activated(layer(vector, precision), layer.bias, layer.beside)  # pyright: ignore[reportArgumentType]
            return vector


class SymmetricPerceptron(nn.Module):
    """A vector with one mirror to a vector with another, through hidden layers of these widths."""

    def __init__(self, inward: Mirror, widths: Sequence[int], outward: Mirror) -> None:
        super().__init__()
        self.trunk, self.last = SymmetricTrunk(inward, widths), LastLayer(widths[-1], outward)

    def forward(self, vector: torch.Tensor) -> torch.Tensor:
        """``(n, outward.size)``."""
        return self.last(self.trunk(vector))


class _Product(torch.autograd.Function):
    """Batched matrix product whose weight gradient is summed over parts of the samples.

    The gradient of a weight is a small matrix summed over tens of thousands of samples: as one product it
    keeps a few multiprocessors of a GPU busy, in parts all of them.
    """

    @staticmethod
    def forward(ctx: Any, inputs: torch.Tensor, weight: torch.Tensor) -> torch.Tensor:
        ctx.save_for_backward(inputs, weight)
        return torch.bmm(inputs, weight)

    @staticmethod
    def backward(ctx: Any, gradient: torch.Tensor) -> tuple[torch.Tensor | None, torch.Tensor]:  # pyright: ignore[reportIncompatibleMethodOverride]
        inputs, weight = ctx.saved_tensors
        back = torch.bmm(gradient, weight.transpose(1, 2)) if ctx.needs_input_grad[0] else None
        return back, torch.stack([_weight_gradient(x, g) for x, g in zip(inputs, gradient, strict=True)])


def _weight_gradient(inputs: torch.Tensor, gradient: torch.Tensor) -> torch.Tensor:
    """``(i, o)`` from ``(n, i)`` and ``(n, o)``."""
    samples = len(inputs)
    parts = _PARTS if inputs.is_cuda and samples % _PARTS == 0 else 1
    inputs, gradient = (each.view(parts, samples // parts, each.shape[1]) for each in (inputs, gradient))
    return torch.bmm(inputs.transpose(1, 2), gradient).sum(0)


def product(inputs: torch.Tensor, weight: torch.Tensor) -> torch.Tensor:
    """``inputs`` ``(b, n, i)`` times ``weight`` ``(b, i, o)``: ``(b, n, o)``."""
    return _Product.apply(inputs, weight)  # pyright: ignore[reportReturnType]


class _Activation(torch.autograd.Function):
    """ELU of each channel of pairs that are given as sums and differences before the bias.

    Each result is rounded before two are put together, and the gradient of the bias is summed from rounded
    numbers: one kernel then writes both halves, each once.
    """

    @staticmethod
    def forward(ctx: Any, pairs: torch.Tensor, bias: torch.Tensor, beside: bool) -> torch.Tensor:
        ctx.save_for_backward(pairs, bias)
        ctx.beside = beside
        u, v = (_elu(each) for each in _channels(pairs, bias, beside))
        return torch.stack(_halves(u, v, pairs.dtype))

    @staticmethod
    def backward(ctx: Any, gradient: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, None]:  # pyright: ignore[reportIncompatibleMethodOverride]
        pairs, bias = ctx.saved_tensors
        u, v = _channels(pairs, bias, ctx.beside)
        s, d = gradient.to(bias.dtype).unbind()
        du, dv = (math.sqrt(0.5) * g * torch.exp(x.clamp(max=0.0)) for g, x in ((s + d, u), (s - d, v)))
        halves = torch.cat(_halves(du, dv, pairs.dtype), 1)
        back = halves[None] if ctx.beside else halves.view(len(u), 2, len(bias)).transpose(0, 1)
        return back, halves[:, : len(bias)].to(bias.dtype).sum(0), None


def activated(pairs: torch.Tensor, bias: torch.Tensor, beside: bool) -> torch.Tensor:
    """ELU of each channel, in sums and differences ``(2, n, k)``.

    Args:
        pairs: sums and differences before the bias ``(2, n, k)``, or side by side ``(1, n, 2 k)``.
        bias: of both channels of a pair ``(k,)``.
        beside: whether they are side by side.
    """
    return _Activation.apply(pairs, bias, beside)  # pyright: ignore[reportReturnType]


def _channels(pairs: torch.Tensor, bias: torch.Tensor, beside: bool) -> tuple[torch.Tensor, torch.Tensor]:
    """Both channels of each pair ``(n, k)``, before the activation."""
    sums, differences = pairs[0].chunk(2, 1) if beside else pairs.unbind()
    s, d = sums + bias, differences.to(bias.dtype)
    return math.sqrt(0.5) * (s + d), math.sqrt(0.5) * (s - d)


def _halves(u: torch.Tensor, v: torch.Tensor, kind: torch.dtype) -> list[torch.Tensor]:
    """Sums and differences of channels, rounded."""
    return [(math.sqrt(0.5) * each).to(kind) for each in (u + v, u - v)]


def _elu(values: torch.Tensor) -> torch.Tensor:
    """ELU; on a GPU by ``exp``, since ``expm1`` alone would take longer than reading and writing."""
    if not values.is_cuda:
        return functional.elu(values)
    return torch.where(values > 0.0, values, torch.exp(values.clamp(max=0.0)) - 1.0)


def _pairs(width: int) -> int:
    if width % 2:
        raise InvalidValueError("width of a symmetric layer", width, "an even number")
    return width // 2


def _uniform(rows: int, columns: int, bound: float) -> torch.Tensor:
    return (2.0 * torch.rand(rows, columns) - 1.0) * bound
