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

from sprintlab.training.distributed import Workers
from sprintlab.training.graphs import compiled

GRADIENT_NORM = 1.0
"""Greatest norm of a group's gradient; longer ones are scaled down to it."""
_ALIGNMENT = 32
"""Every tensor starts at a multiple of so many numbers (128 bytes): matrix kernels want aligned operands."""


class ParameterBlock:
    """Groups of parameters with one Adam optimizer; the norm of each group's gradient is limited on its own.

    The parameters keep their values and become views on ``values``; loading a state dict copies into them.

    Args:
        groups: parameters, all on one device.
        rate: the learning rate, a number on the device that may be changed between steps ``()``.
        fused: compile what limits the norm (GPU only).

    Attributes:
        values: all parameters ``(size,)``, with unused numbers, always zero, between them.
        gradient: of ``values`` ``(size,)``.
    """

    def __init__(self, groups: Sequence[Sequence[nn.Parameter]], rate: torch.Tensor, fused: bool) -> None:
        self.parameters = [parameter for group in groups for parameter in group]
        starts = list(itertools.accumulate((_padded(p.numel()) for p in self.parameters), initial=0))
        ends = list(itertools.accumulate((len(group) for group in groups), initial=0))
        self.values = nn.Parameter(self.parameters[0].detach().new_zeros(starts[-1]))
        self.gradient = torch.zeros_like(self.values)
        self.values.grad = self.gradient
        self._groups = [self.gradient[starts[a] : starts[b]] for a, b in itertools.pairwise(ends)]
        self._fillers = [
            self.values.detach().new_zeros(end - start - parameter.numel())
            for (start, end), parameter in zip(itertools.pairwise(starts), self.parameters, strict=True)
        ]
        for start, parameter in zip(starts[:-1], self.parameters, strict=True):
            view = self.values.detach()[start : start + parameter.numel()].view_as(parameter)
            view.copy_(parameter.detach())
            parameter.data = view
        self._limit = compiled(_limit_norms, fused)
        self.optimizer = self._adam(rate)

    def _adam(self, rate: torch.Tensor) -> torch.optim.Adam:
        """Adam whose whole step runs on the device; its state exists from the start."""
        on_gpu = self.values.is_cuda
        optimizer = torch.optim.Adam([self.values], lr=rate, fused=on_gpu, foreach=False, capturable=on_gpu)
        optimizer.step()
        for moment in optimizer.state[self.values].values():
            moment.zero_()
        return optimizer

    def state(self) -> list[torch.Tensor]:
        """What Adam remembers, in a fixed order."""
        return [value for _, value in sorted(self.optimizer.state[self.values].items())]

    def descend(self, loss: torch.Tensor, workers: Workers) -> None:
        """One step down the gradient of a loss ``()``, averaged over the processes."""
        gradients = [gradient.reshape(-1) for gradient in torch.autograd.grad(loss, self.parameters)]
        pieces = itertools.chain.from_iterable(zip(gradients, self._fillers, strict=True))
        torch.cat(list(pieces), out=self.gradient)
        workers.average(self.gradient)
        self._limit(self._groups)
        self.optimizer.step()


def _padded(count: int) -> int:
    return -(-count // _ALIGNMENT) * _ALIGNMENT


def _limit_norms(gradients: Sequence[torch.Tensor]) -> None:
    """Scale each gradient down to ``GRADIENT_NORM``, as ``torch.nn.utils.clip_grad_norm_`` does."""
    for gradient in gradients:
        gradient.mul_((GRADIENT_NORM / (gradient.norm() + 1e-6)).clamp(max=1.0))
