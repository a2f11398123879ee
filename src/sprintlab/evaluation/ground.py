"""What slopes and rough ground cost a policy: speed held against that on level ground, and falls."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from sprintlab.core.checks import check_positive, check_range
from sprintlab.core.json_values import json_ready
from sprintlab.evaluation.pool import TrialPool
from sprintlab.evaluation.protocol import ProtocolSettings
from sprintlab.evaluation.sweep import Case, Progress, Run, held_speeds, mean, of_group, run_cases
from sprintlab.plant import Ground, PlantOptions

LARGEST_LOSS = 0.15
"""Share of the speed held on level ground that slopes and rough ground may cost."""

_STANDS = 0.1  # who holds no more does not run [m/s]


@dataclass(frozen=True, kw_only=True)
class GroundSettings:
    """What is run.

    Raises:
        InvalidValueError: a number is out of range.
    """

    top_speed: float  # v* of every profile [m/s]
    trials: int = 3  # seeded trials on each ground, the protocol's; rough ground is drawn anew for each
    slope: float = 0.05  # rise over run, up and down
    roughness: float = 0.02  # greatest height of the rough ground above and below its mean [m]
    hold: float = 10.0  # duration of each hold [s]
    plant: PlantOptions = field(default_factory=PlantOptions)  # its ground is replaced

    def __post_init__(self) -> None:
        check_range("ground.top_speed", self.top_speed, 0.5, 16.0, "m/s")
        check_range("ground.trials", self.trials, 1, 10_000)
        check_positive("ground.slope", self.slope)
        check_positive("ground.roughness", self.roughness, "m")
        Ground(slope=self.slope, roughness=self.roughness)

    def cases(self) -> list[Case]:
        """Every trial, kind by kind, level ground first; the same draws on each."""
        protocol = ProtocolSettings(trials=self.trials, required=1, hold=self.hold, plant=self.plant)
        drawn = list(enumerate(protocol.requests(self.top_speed, self_paced=False)))
        kinds = {
            "level": lambda seed: Ground(),
            "uphill": lambda seed: Ground(slope=self.slope),
            "downhill": lambda seed: Ground(slope=-self.slope),
            "rough": lambda seed: Ground(roughness=self.roughness, seed=seed),
        }
        return [
            Case(group=kind, request=replace(request, plant=replace(self.plant, ground=make(seed))))
            for kind, make in kinds.items()
            for seed, request in drawn
        ]


def compare_grounds(
    pool: TrialPool, settings: GroundSettings, progress: Progress = lambda *_: None
) -> dict[str, Any]:
    """Run every trial, and give ``ground_numbers``; errors as in ``run_cases``."""
    return ground_numbers(settings, run_cases(pool, settings.cases(), progress))


def ground_numbers(settings: GroundSettings, runs: Sequence[Run]) -> dict[str, Any]:
    """JSON-ready numbers of each ground, level ground first; speeds are means of the upright runs.

    ``change`` is the held speed over that on level ground, minus one; null where no robot runs there.
    ``met``: every trial stayed upright and the loss is within ``LARGEST_LOSS``.
    """
    level, rows = mean(held_speeds(of_group(runs, runs[0].group))), list[dict[str, Any]]()
    for name in dict.fromkeys(run.group for run in runs):
        here = of_group(runs, name)
        falls = [run.fall_reason for run in here if not run.upright]
        held = mean(held_speeds(here))
        change = held / level - 1.0 if level > _STANDS else math.nan
        rows.append(
            {
                "ground": name,
                "trials": len(here),
                "upright": len(here) - len(falls),
                "fall_reasons": falls,
                "held_speed_m_s": held,
                "change": change,
                "met": not falls and change >= -LARGEST_LOSS,
            }
        )
    return json_ready(
        {
            "top_speed_command_m_s": settings.top_speed,
            "slope": settings.slope,
            "roughness_m": settings.roughness,
            "largest_loss": LARGEST_LOSS,
            "grounds": rows,
        }
    )
