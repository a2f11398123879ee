"""Multilayer perceptrons with ELU, forward and backward, plain or exactly symmetric left and right.

Hidden channels of a symmetric network come in pairs ``(u, v)`` that the mirror exchanges. A linear map that
commutes with the mirror is diagonal in sums and differences of the pairs,

    s = (u + v) / sqrt 2,  d = (u - v) / sqrt 2,      s' = A s + b,  d' = B d,

which is half the arithmetic of a dense layer of the same width. Inputs and outputs are sums and differences
of their mirrored numbers, too (``Basis``), so that every layer is one batched product: ``(2, n, k)``
throughout, sums first. A plain network is the same with one half, ``(1, n, k)``.

The backward pass is written out: losses, gradients and optimizer step of a mini-batch are then one graph for
the compiler, which can keep it from one start to the next.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import torch
from torch import nn
from torch.nn import functional

from sprintlab.core.errors import InvalidValueError
from sprintlab.training.learner.mirror import Basis

_PARTS = 32
"""Parts of the samples over which the gradient of a weight is summed apart on a GPU: as one product it would
keep a few multiprocessors busy, in parts all of them."""

Tape = list[torch.Tensor]
"""Each layer's input ``(halves, n, k)``."""
Mixing = tuple[torch.Tensor, torch.Tensor]
"""Factors of a number itself and of the one at its place in the other half, of the shape of a parameter."""


class Layer(nn.Module):
    """A product of each half; the bias belongs to the first.

    Args:
        weight: ``(halves, inputs, outputs)``.
        bias: ``(outputs,)``.

    Attributes:
        rounded: the weight in half precision; None outside of a training.
        mixings: mixings of weight and bias, see ``Perceptron.mixed_parameters``.
    """

    rounded: torch.Tensor | None

    def __init__(self, weight: torch.Tensor, bias: torch.Tensor) -> None:
        super().__init__()
        self.weight, self.bias, self.rounded = nn.Parameter(weight), nn.Parameter(bias), None
        self.mixings: list[Mixing] = [(torch.ones_like(p), torch.zeros_like(p)) for p in (weight, bias)]

    def matrix(self, precision: torch.dtype) -> torch.Tensor:
        """The weight in a precision."""
        if precision == self.weight.dtype:
            return self.weight
        return self.weight.to(precision) if self.rounded is None else self.rounded


class Perceptron(nn.Module):
    """A vector ``(n, inward.size)`` to another ``(n, outward.size)``, ELU behind each layer but the last.

    The last layer computes in single precision also where the layers before it have less: a value of 20 has
    steps of 0.1 in eight bits, and the reward of a policy step is a few hundredths.

    Args:
        inward: coordinates of the input.
        widths: widths of the hidden layers.
        outward: coordinates of the output, with as many halves.
    """

    def __init__(self, inward: Basis, widths: Sequence[int], outward: Basis) -> None:
        super().__init__()
        self.inward, self.outward = inward, outward
        for width in widths:
            if width % inward.halves:
                raise InvalidValueError("width of a symmetric layer", width, "an even number")
        channels = [width // inward.halves for width in widths]
        hidden = [_hidden_layer(inward.halves, *sizes) for sizes in itertools.pairwise(channels)]
        last = _last_layer(channels[-1], outward)
        self.layers = nn.ModuleList([_first_layer(inward, channels[0]), *hidden, last])

    def forward(self, vector: torch.Tensor, precision: torch.dtype = torch.float32) -> torch.Tensor:
        """The output ``(n, outward.size)``, from products in a precision."""
        return self.recorded(vector, precision)[0]

    def recorded(
        self, vector: torch.Tensor, precision: torch.dtype = torch.float32
    ) -> tuple[torch.Tensor, Tape]:
        """The output ``(n, outward.size)``, and what ``gradients`` needs."""
        *hidden, last = self.stack
        tape = [self.inward(vector).to(precision)]
        for layer in hidden:
            kept = last.weight.dtype if layer is hidden[-1] else precision
            tape.append(_activated(torch.bmm(tape[-1], layer.matrix(precision)), layer.bias, kept))
        first, *others = torch.bmm(tape[-1], last.weight).unbind()
        return self.outward.inverse([first + last.bias, *others]), tape

    def gradients(self, tape: Tape, gradient: torch.Tensor) -> tuple[list[torch.Tensor], torch.Tensor]:
        """Gradients of the parameters, in their order, and of the first layer's products.

        Args:
            tape: tape of ``recorded``.
            gradient: gradient of the output ``(n, outward.size)``.
        """
        found: list[torch.Tensor] = []
        layers, back = self.stack, self.outward(gradient)
        for place in range(len(tape) - 1, -1, -1):
            if place < len(tape) - 1:
                following = layers[place + 1].matrix(back.dtype)
                back = torch.bmm(back, following.transpose(1, 2))
                back = _through_activation(tape[place + 1], back, tape[0].dtype)
            bias = back[0].sum(0, dtype=layers[place].bias.dtype)
            found = [_weight_gradient(tape[place], back), bias, *found]
        return found, back

    def input_gradient(self, back: torch.Tensor) -> torch.Tensor:
        """Gradient of the input ``(n, inward.size)`` from that of the first layer's products."""
        first = self.stack[0].matrix(back.dtype)
        return self.inward.inverse(torch.bmm(back, first.transpose(1, 2)).unbind())

    @property
    def stack(self) -> list[Layer]:
        """The layers, hidden ones first."""
        return list(self.layers)  # pyright: ignore[reportReturnType]

    def mixed_parameters(self) -> list[tuple[nn.Parameter, Mixing]]:
        """Each parameter, and how it follows from the numbers that learn.

        First and last layer of a symmetric network learn the weights of one channel of each pair; those of
        sums and differences of mirrored inputs are sums and differences of these (the map is its own
        transpose, and its own inverse but for a factor of two).
        """
        return [pair for layer in self.stack for pair in zip(layer.parameters(), layer.mixings, strict=True)]


def _first_layer(inward: Basis, channels: int) -> Layer:
    bound = 1.0 / math.sqrt(inward.size)
    weight = math.sqrt(inward.halves) * inward.matrix @ _uniform(bound, inward.size, channels)
    layer = Layer(weight.view(inward.halves, -1, channels), _uniform(bound, channels))
    layer.mixings[0] = _mixing(inward, layer.weight, 1)
    return layer


def _hidden_layer(halves: int, inputs: int, outputs: int) -> Layer:
    bound = 1.0 / math.sqrt(inputs)
    return Layer(_uniform(bound, halves, inputs, outputs), _uniform(bound, outputs))


def _last_layer(channels: int, outward: Basis) -> Layer:
    bound = 1.0 / math.sqrt(channels * outward.halves)
    weight = math.sqrt(outward.halves) * outward.matrix @ _uniform(bound, outward.size, channels)
    bias = outward.matrix[: outward.columns] @ _uniform(bound, outward.size)
    layer = Layer(weight.view(outward.halves, -1, channels).transpose(1, 2).contiguous(), bias)
    layer.mixings[0] = _mixing(outward, layer.weight, 2)
    layer.mixings[1][0][: outward.pairs] = math.sqrt(2.0)
    return layer


def _mixing(basis: Basis, weight: torch.Tensor, axis: int) -> Mixing:
    """The mixing of a weight, one axis of which holds a basis's columns."""
    own, other = torch.ones(2, basis.halves, basis.columns).unbind()
    if basis.halves == 2:
        own.fill_(math.sqrt(2.0))
        own[0, : basis.pairs], own[1, : basis.pairs] = 1.0, -1.0
    other[:, basis.pairs :] = 0.0
    axis = 3 - axis
    return own.unsqueeze(axis).expand_as(weight).clone(), other.unsqueeze(axis).expand_as(weight).clone()


def _rotated(one: torch.Tensor, other: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Sum and difference over sqrt 2: its own inverse."""
    return math.sqrt(0.5) * (one + other), math.sqrt(0.5) * (one - other)


def _channels(halves: Sequence[torch.Tensor]) -> Sequence[torch.Tensor]:
    """Both channels of each pair ``(n, k)`` from their sums and differences, and the other way round."""
    return _rotated(*halves) if len(halves) == 2 else halves


def _stacked(halves: Sequence[torch.Tensor], precision: torch.dtype) -> torch.Tensor:
    """As ``(halves, n, k)``. Each is rounded before they are put together: one kernel then writes both
    halves, each once."""
    return torch.stack([half.to(precision) for half in halves])


def _activated(product: torch.Tensor, bias: torch.Tensor, precision: torch.dtype) -> torch.Tensor:
    """ELU of each channel ``(halves, n, k)``, from a product before the bias."""
    first, *others = product.unbind()
    channels = _channels([first + bias, *(other.to(bias.dtype) for other in others)])
    return _stacked(_channels([_elu(each) for each in channels]), precision)


def _through_activation(values: torch.Tensor, gradient: torch.Tensor, precision: torch.dtype) -> torch.Tensor:
    """Gradient before an activation that gave ``values``, from that behind it ``(halves, n, k)``.

    The slope of ELU is 1, or 1 more than its value where that is negative. (Of the values alone, so that few
    numbers are read: the compiler makes two kernels of one that reads more than four tensors.)
    """
    slopes = [1.0 + each.clamp(max=0.0) for each in _channels(values.float().unbind())]
    channels = _channels(gradient.float().unbind())
    before = [each * slope for each, slope in zip(channels, slopes, strict=True)]
    return _stacked(_channels(before), precision)


def _weight_gradient(values: torch.Tensor, gradient: torch.Tensor) -> torch.Tensor:
    """``(halves, i, o)`` in single precision, from ``(halves, n, i)`` and ``(halves, n, o)``."""
    halves, samples, inputs = values.shape
    parts = _PARTS if values.is_cuda and samples % _PARTS == 0 else 1
    values, gradient = (each.reshape(halves * parts, samples // parts, -1) for each in (values, gradient))
    products = torch.bmm(values.transpose(1, 2), gradient).view(halves, parts, inputs, -1)
    return products[:, 0].float() if parts == 1 else products.sum(1, dtype=torch.float32)


def _elu(values: torch.Tensor) -> torch.Tensor:
    """ELU; on a GPU by ``exp``, since ``expm1`` alone would take longer than reading and writing."""
    if not values.is_cuda:
        return functional.elu(values)
    return torch.where(values > 0.0, values, torch.exp(values.clamp(max=0.0)) - 1.0)


def _uniform(bound: float, *shape: int) -> torch.Tensor:
    return (2.0 * torch.rand(*shape) - 1.0) * bound
