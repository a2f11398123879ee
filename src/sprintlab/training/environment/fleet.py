"""The robots of a training with what was drawn for each of them."""

from __future__ import annotations

from collections.abc import Mapping

import torch

from sprintlab.engine import Engine
from sprintlab.training.terms import RandomizationTerm


class Fleet:
    """Robots that differ, from PyTorch's global generator.

    Attributes:
        engine: engine of the robots.
        slope: angle by which the ground rises along x [rad] ``(n,)``.
        delay: mean delay of the joint targets [substeps] ``(n,)``.
        delay_jitter: by which it changes from step to step, either way [substeps].
        joint_offset: error of each encoder's zero [rad] ``(n, joints)``.
    """

    def __init__(self, engine: Engine, terms: Mapping[str, RandomizationTerm]) -> None:
        self.engine = engine
        self.slope, self.delay = (torch.zeros(engine.robots, device=engine.device) for _ in range(2))
        self.joint_offset, self.delay_jitter = torch.zeros_like(engine.stiffness), 0.0
        for term in terms.values():
            term.function(self, **term.parameters)

    def uniform(self, low: float, high: float, *columns: int) -> torch.Tensor:
        """One draw for each robot ``(n, *columns)``."""
        shape = (self.engine.robots, *columns)
        return low + (high - low) * torch.rand(*shape, device=self.engine.device)
