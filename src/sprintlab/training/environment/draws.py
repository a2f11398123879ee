"""The random numbers of one environment step: one block, drawn by one kernel, cut into named columns.

The same block given to two environments makes them do the same: the fast path can be compared with the plain
one, step by step.
"""

from __future__ import annotations

import torch

COLUMNS = {
    "push": 3,
    "restart": 3,
    "donor": 2,
    "clone": 1,
    "joint": 12,
    "start": 2,
    "spin": 3,
    "command": 8,
    "noise": 30,
    "delay": 1,
}
"""Names and widths: ``push`` whether, along x, along y; ``restart`` heading, height, whether fast; ``donor``
two candidates; ``clone`` whether; ``joint`` pose noise; ``start`` speed if fast, if slow; ``spin`` angular
velocity; ``command`` for the schedule; ``noise`` on the proprioception; ``delay`` of the next
targets."""


class Draws:
    """Uniform numbers in [0, 1), ``(n, width)`` by name; views on one block."""

    def __init__(self, robots: int, device: str) -> None:
        self.block = torch.zeros(robots, sum(COLUMNS.values()), device=device)
        pieces = self.block.split(list(COLUMNS.values()), dim=1)
        self._named = dict(zip(COLUMNS, pieces, strict=True))

    def refill(self) -> None:
        """Draw them all anew from PyTorch's generator of the device."""
        self.block.uniform_()

    def __getitem__(self, name: str) -> torch.Tensor:
        return self._named[name]
