"""Parameters that learn together, in one block of memory: one kernel where a list would take dozens.

A gradient step on some thirty small tensors is mostly launches. Here the tensors are views on one block, and
so are their gradients: limiting the norm, Adam, the exchange between processes and a copy for safety are each
a handful of kernels, whatever the number of layers. ``torch.optim.Adam`` works in pieces of 65,536 numbers,
too few to fill a GPU with one block: its step took longer than the backward pass of a layer.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import torch
from torch import nn

from sprintlab.training.graphs import compiled
from sprintlab.training.learner.distributed import Workers

GRADIENT_NORM = 1.0
"""Greatest norm of a group's gradient; longer ones are scaled down to it."""
DECAY, SQUARE_DECAY, EPSILON = 0.9, 0.999, 1e-8
"""Adam's, as PyTorch has them."""
_SAMPLES = 256
"""A mean over so many samples goes back through the layers as it is."""
_ALIGNMENT = 32
"""Every tensor starts at a multiple of so many numbers (128 bytes): matrix kernels want aligned operands."""


class ParameterBlock:
    """Groups of parameters with one Adam optimizer; the norm of each group's gradient is limited on its own.

    The parameters keep their values and become views on ``values``; loading a state dict copies into them.

    Args:
        groups: parameters, all on one device.
        rate: the learning rate, a number on the device that may be changed between steps ``()``.
        fused: compile the step (GPU only).

    Attributes:
        values: all parameters ``(size,)``, with unused numbers, always zero, between them.
        gradient: of ``values`` ``(size,)``.
    """

    def __init__(self, groups: Sequence[Sequence[nn.Parameter]], rate: torch.Tensor, fused: bool) -> None:
        self.parameters = [parameter for group in groups for parameter in group]
        starts = list(itertools.accumulate((_padded(p.numel()) for p in self.parameters), initial=0))
        ends = list(itertools.accumulate((len(group) for group in groups), initial=0))
        self.rate, self._groups = rate, [(starts[a], starts[b]) for a, b in itertools.pairwise(ends)]
        self.values = self.parameters[0].detach().new_zeros(starts[-1])
        self.gradient, self._mean, self._square = (torch.zeros_like(self.values) for _ in range(3))
        self._count = self.values.new_zeros(())
        self._fillers = [
            self.values.new_zeros(end - start - parameter.numel())
            for (start, end), parameter in zip(itertools.pairwise(starts), self.parameters, strict=True)
        ]
        for start, parameter in zip(starts[:-1], self.parameters, strict=True):
            view = self.values[start : start + parameter.numel()].view_as(parameter)
            view.copy_(parameter.detach())
            parameter.data = view
        self._adam = compiled(self._step, fused)

    def state(self) -> list[torch.Tensor]:
        """What Adam remembers: both moments ``(size,)``, and the number of steps ``()``."""
        return [self._mean, self._square, self._count]

    def descend(self, loss: torch.Tensor, workers: Workers, samples: int) -> None:
        """One step down the gradient of a loss ``()``, averaged over the processes.

        Args:
            loss: a mean over ``samples``.
            workers: the processes.
            samples: so many; half precision loses a single sample's share of a mean over tens of thousands,
                and the loss is made larger by a power of two before it goes back through the layers.
        """
        scale = 2.0 ** round(math.log2(max(1.0, samples / _SAMPLES)))
        gradients = [gradient.reshape(-1) for gradient in torch.autograd.grad(scale * loss, self.parameters)]
        pieces = itertools.chain.from_iterable(zip(gradients, self._fillers, strict=True))
        torch.cat(list(pieces), out=self.gradient)
        self.gradient.mul_(1.0 / scale)
        workers.average(self.gradient)
        self._adam()

    @torch.no_grad()
    def _step(self) -> None:
        """Adam along the gradient, of which each group's norm is limited (``clip_grad_norm_``'s formula)."""
        self._count.add_(1)
        step = self.rate / (1.0 - DECAY**self._count)
        unbiased = (1.0 - SQUARE_DECAY**self._count).sqrt()
        for first, last in self._groups:
            gradient, mean, square = (v[first:last] for v in (self.gradient, self._mean, self._square))
            gradient = gradient * (GRADIENT_NORM / (gradient.norm() + 1e-6)).clamp(max=1.0)
            mean.lerp_(gradient, 1.0 - DECAY)
            square.lerp_(gradient * gradient, 1.0 - SQUARE_DECAY)
            self.values[first:last] -= step * mean / (square.sqrt() / unbiased + EPSILON)


def _padded(count: int) -> int:
    return -(-count // _ALIGNMENT) * _ALIGNMENT
