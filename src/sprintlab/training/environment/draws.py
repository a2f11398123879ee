"""The random numbers of one environment step: one block, drawn by one kernel, cut into named columns.

The same block given to two environments makes them do the same: the fast path can be compared with the plain
one, step by step.
"""

from __future__ import annotations

import torch

from sprintlab.control import Observation


def columns(observation: Observation) -> dict[str, int]:
    """Names and widths of the columns for a robot with this observation.

    ``push`` whether, along x, along y; ``restart`` heading, height, whether fast; ``donor`` two candidates;
    ``clone`` whether; ``joint`` pose noise; ``start`` speed if fast, if slow; ``spin`` angular velocity;
    ``command`` for the schedule; ``noise`` on what is measured; ``delay`` of the next targets; ``handedness``
    of an episode; ``temperature`` of its windings.
    """
    return {
        "push": 3,
        "restart": 3,
        "donor": 2,
        "clone": 1,
        "joint": observation.joints,
        "start": 2,
        "spin": 3,
        "command": 8,
        "noise": observation.measured_size,
        "delay": 1,
        "handedness": 1,
        "temperature": observation.joints,
    }


class Draws:
    """Uniform numbers in [0, 1), ``(n, width)`` by name; views on one block."""

    def __init__(self, robots: int, observation: Observation, device: str) -> None:
        widths = columns(observation)
        self.block = torch.zeros(robots, sum(widths.values()), device=device)
        pieces = self.block.split(list(widths.values()), dim=1)
        self._named = dict(zip(widths, pieces, strict=True))

    def refill(self) -> None:
        """Draw them all anew from PyTorch's generator of the device."""
        self.block.uniform_()

    def __getitem__(self, name: str) -> torch.Tensor:
        return self._named[name]
