"""The same speeds asked for in different ways: what the paper calls command update modes."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from sprintlab.commands import self_paced
from sprintlab.control import POLICY_RATE_HZ
from sprintlab.core.checks import check_choice, check_positive, check_range
from sprintlab.plant import BaseState

COMMAND_MODES = ("uniform", "fixed-acceleration", "adaptive", "step")
"""``"uniform"`` jumps to each target; ``"fixed-acceleration"`` rises and falls to it at a fixed rate;
``"adaptive"`` stays within a window of the present speed (ACS); ``"step"`` jumps to the top speed at once."""

_STEP = 1.0 / POLICY_RATE_HZ  # the command is renewed with every policy step [s]


@dataclass(kw_only=True)
class CommandSequence:
    """A course of speed targets, drawn uniformly, in one of the update modes.

    Attributes:
        mode: one of ``COMMAND_MODES``.
        top_speed: highest target [m/s].
        count: number of targets.
        period: time for which each lasts [s].
        stand: time at rest before the first [s].
        acceleration: of the fixed-acceleration mode [m/s^2].
        window: of the adaptive mode [m/s].
        seed: of the targets; the same in every mode.

    Raises:
        InvalidValueError: an unknown mode or a number out of range.
    """

    mode: str
    top_speed: float
    count: int = 5
    period: float = 4.0
    stand: float = 1.0
    acceleration: float = 3.0
    window: float = 1.0
    seed: int = 1
    _command: float = field(default=0.0, init=False)

    def __post_init__(self) -> None:
        check_choice("mode", self.mode, COMMAND_MODES)
        check_range("count", self.count, 1, 1000)
        for name in ("top_speed", "period", "acceleration", "window"):
            check_positive(name, getattr(self, name))

    @property
    def targets(self) -> tuple[float, ...]:
        """Speed targets in order [m/s]."""
        if self.mode == "step":
            return (self.top_speed,) * self.count
        drawn = np.random.default_rng(self.seed).uniform(0.0, self.top_speed, self.count)
        return tuple(drawn.tolist())

    @property
    def longest(self) -> float:
        """Length of the whole course [s]."""
        return self.stand + self.count * self.period

    def target(self, time: float) -> float:
        """Target at ``time`` [s]; zero before the first."""
        index = int((time - self.stand + 1e-9) // self.period)
        return self.targets[min(index, self.count - 1)] if index >= 0 else 0.0

    def speed(self, time: float, base: BaseState) -> float | None:
        """Commanded speed [m/s] from the target and the robot's present speed; ``None`` at the end.

        Asked once in every policy step.
        """
        if time >= self.longest - 1e-9:
            return None
        self._command = self._next(self.target(time), base.forward_speed)
        return self._command

    def _next(self, target: float, present: float) -> float:
        if self.mode == "fixed-acceleration":
            step = self.acceleration * _STEP
            return float(np.clip(target, self._command - step, self._command + step))
        if self.mode == "adaptive":
            return float(self_paced(target, present, self.window))
        return target
