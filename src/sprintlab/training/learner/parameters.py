"""Parameters that learn together, in one block of memory: one kernel where a list would take dozens.

A gradient step on some thirty small tensors is mostly launches. Here the tensors are views on one block, and
so are their gradients: limiting the norm, Adam, the exchange between processes and a copy for safety are each
a handful of kernels, whatever the number of layers.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import torch
from torch import nn

from sprintlab.training.learner.perceptron import Mixing

GRADIENT_NORM = 1.0
"""Greatest norm of a group's gradient; longer ones are scaled down to it."""
DECAY, SQUARE_DECAY, EPSILON = 0.9, 0.999, 1e-8
"""Adam's, as PyTorch has them."""
_ALIGNMENT = 32
"""Every tensor starts at a multiple of so many numbers (128 bytes): matrix kernels want aligned operands."""


class ParameterBlock:
    """Groups of parameters with one Adam optimizer; the norm of each group's gradient is limited on its own.

    The parameters keep their values and become views on ``values``; loading a state dict copies into them.
    What learns are numbers from which the parameters follow by their mixings, see
    ``Perceptron.mixed_parameters``.

    Args:
        groups: parameters, all on one device, each with its mixing.
        rate: the learning rate, a number on the device that may be changed between steps ``()``.

    Attributes:
        values: all parameters ``(size,)``, with unused numbers, always zero, between them.
        rounded: ``values`` in half precision, as of the last step or ``refresh`` ``(size,)``.
        gradient: gradient of ``values`` ``(size,)``.
    """

    def __init__(
        self, groups: Sequence[Sequence[tuple[nn.Parameter, Mixing | None]]], rate: torch.Tensor
    ) -> None:
        pairs = [pair for group in groups for pair in group]
        self.parameters, self.rate = [parameter for parameter, _ in pairs], rate
        self._starts = list(itertools.accumulate((_padded(p.numel()) for p in self.parameters), initial=0))
        ends = list(itertools.accumulate((len(group) for group in groups), initial=0))
        self._groups = [(self._starts[a], self._starts[b]) for a, b in itertools.pairwise(ends)]
        self.values = self.parameters[0].detach().new_zeros(self._starts[-1])
        self.gradient, self._mean, self._square = (torch.zeros_like(self.values) for _ in range(3))
        self._count, self.rounded = self.values.new_zeros(()), self.values.half()
        self._places = dict(zip(map(id, self.parameters), self._starts, strict=False))
        self._own, self._other = torch.ones_like(self.values), torch.zeros_like(self.values)
        self._partner = torch.arange(len(self.values), device=self.values.device)
        for parameter, mixing in pairs:
            if mixing is not None:
                self._mix(parameter, *mixing)
            view = self.part(self.values, parameter)
            view.copy_(parameter.detach())
            parameter.data = view
        self.refresh()

    def _mix(self, parameter: nn.Parameter, own: torch.Tensor, other: torch.Tensor) -> None:
        """Write a parameter's mixing into the tables of ``_mixed``."""
        self.part(self._own, parameter).copy_(own)
        self.part(self._other, parameter).copy_(other)
        partner = self.part(self._partner, parameter)
        partner.copy_(torch.where(other.to(partner.device) != 0.0, partner.flip(0), partner))

    def place(self, parameter: nn.Parameter) -> slice:
        """Where a parameter is in the blocks."""
        start = self._places[id(parameter)]
        return slice(start, start + parameter.numel())

    def part(self, block: torch.Tensor, parameter: nn.Parameter) -> torch.Tensor:
        """A parameter's part of a block ``(size,)``, of its shape."""
        return block[self.place(parameter)].view(parameter.shape)

    def state(self) -> list[torch.Tensor]:
        """What Adam remembers: both moments ``(size,)``, and the number of steps ``()``."""
        return [self._mean, self._square, self._count]

    def refresh(self) -> None:
        """Round the values again, after they were changed from outside."""
        self.rounded.copy_(self.values)

    def write(self, gradients: Sequence[torch.Tensor], scale: float = 1.0) -> None:
        """Take gradients of the parameters, in their order, ``scale`` times too large, for the next step."""
        pieces: list[torch.Tensor] = []
        for (start, end), gradient in zip(itertools.pairwise(self._starts), gradients, strict=True):
            pieces += [gradient.flatten(), self.values.new_zeros(end - start - gradient.numel())]
        self.gradient.copy_(torch.cat([piece for piece in pieces if piece.numel()]) * (1.0 / scale))

    @torch.no_grad()
    def step(self) -> None:
        """Adam along the gradient, of which each group's norm is limited (``clip_grad_norm_``'s formula)."""
        self._count.add_(1)
        step = self.rate / (1.0 - DECAY**self._count)
        unbiased = (1.0 - SQUARE_DECAY**self._count).sqrt()
        gradient = self._mixed(self.gradient)
        factors = [
            (GRADIENT_NORM / (gradient[first:last].norm() + 1e-6)).clamp(max=1.0).expand(last - first)
            for first, last in self._groups
        ]
        gradient = gradient * torch.cat(factors)
        self._mean.lerp_(gradient, 1.0 - DECAY)
        self._square.lerp_(gradient * gradient, 1.0 - SQUARE_DECAY)
        self.values -= self._mixed(step * self._mean / (self._square.sqrt() / unbiased + EPSILON))
        self.refresh()

    def _mixed(self, numbers: torch.Tensor) -> torch.Tensor:
        """From what learns to the parameters, and, being its own transpose, from gradients to gradients."""
        return self._own * numbers + self._other * numbers[self._partner]


def _padded(count: int) -> int:
    return -(-count // _ALIGNMENT) * _ALIGNMENT
