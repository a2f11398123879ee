"""Numbers that wait on the device until an iteration ends, and are then read back in one go."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import torch

from sprintlab.training.learner.distributed import Workers


class MetricBuffer(NamedTuple):
    """Named numbers on a device."""

    names: Sequence[str]  # one a number
    values: torch.Tensor  # (len(names),)

    def read(self) -> dict[str, float]:
        """The numbers; waits for the device."""
        return dict(zip(self.names, self.values.tolist(), strict=True))


def joined(parts: Sequence[MetricBuffer], workers: Workers) -> MetricBuffer:
    """All parts as one, each number the mean over the processes: their curricula take the same step."""
    values = torch.cat([part.values for part in parts])
    workers.average(values)
    return MetricBuffer([name for part in parts for name in part.names], values)
