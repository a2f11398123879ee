"""How the highest speed that a policy completes is searched for."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sprintlab.evaluation.protocol import ProtocolSettings

FIRST_PASS = 1.0  # [m/s]


def protocol_settings(trials: int, seed: int, **more: Any) -> ProtocolSettings:
    """Settings with nine of ten trials required, rounded up.

    Raises:
        InvalidValueError: a setting is out of range.
    """
    from sprintlab.core.checks import check_range
    from sprintlab.evaluation.protocol import ProtocolSettings

    check_range("trials", trials, 1, 10_000)
    return ProtocolSettings(trials=trials, required=-(-trials * 9 // 10), seed=seed, **more)


@dataclass(frozen=True, kw_only=True)
class SearchOptions:
    """How the highest speed is searched for.

    Attributes:
        trials: seeded trials a speed.
        seed: decides joint noise, friction and payload of every trial.
        start: lowest speed of the search [m/s].
        top: highest speed of the search [m/s].
        grid: step between speeds [m/s].
        every_speed: walk the whole grid instead of whole m/s first.
    """

    trials: int = 10
    seed: int = 0
    start: float = 1.0
    top: float = 16.0
    grid: float = 0.25
    every_speed: bool = False

    def protocol(self, **more: Any) -> ProtocolSettings:
        """Settings of the protocol; ``more`` are its fields that the search does not set.

        Raises:
            InvalidValueError: a setting is out of range.
        """
        from sprintlab.core.arguments import check_fields

        check_fields(self)
        return protocol_settings(
            self.trials,
            self.seed,
            start=self.start,
            top=self.top,
            grid=self.grid,
            first_step=self._first_step(),
            **more,
        )

    def share(self, top_speed: float) -> float:
        """How far from start to top a search has come."""
        return (top_speed - self.start) / max(self.top - self.start, 1e-9)

    def _first_step(self) -> float | None:
        """Of the first pass [m/s]: 1 m/s where that is on the grid; ``None`` walks the whole grid."""
        steps = FIRST_PASS / self.grid if self.grid > 0.0 else 0.0
        on_grid = 1.0 < steps < math.inf and abs(steps - round(steps)) < 1e-6
        return FIRST_PASS if on_grid and not self.every_speed else None
