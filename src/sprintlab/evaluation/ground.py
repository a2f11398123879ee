"""What slopes and rough ground cost a policy: speed held against that on level ground, and falls."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

from sprintlab.core.checks import check_positive, check_range
from sprintlab.core.json_values import json_ready
from sprintlab.evaluation.pool import TrialPool
from sprintlab.evaluation.protocol import ProtocolSettings
from sprintlab.evaluation.sweep import Case, Progress, held_speeds, mean, of_group, run_cases
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


@dataclass(frozen=True, kw_only=True)
class GroundTrials:
    """The trials on one kind of ground."""

    name: str  # "level", "uphill", "downhill" or "rough"
    trials: int  # how many ran
    held_speed: float  # along the ground, mean of the upright [m/s]; nan where all fell
    falls: tuple[str, ...] = ()  # the reason of each fall

    @property
    def upright(self) -> int:
        """How many did not fall."""
        return self.trials - len(self.falls)


@dataclass(frozen=True, kw_only=True)
class GroundResult:
    """All trials of one policy; level ground is the first of ``grounds``."""

    settings: GroundSettings
    grounds: tuple[GroundTrials, ...]

    def change(self, found: GroundTrials) -> float:
        """Held speed against that on level ground, as a share; ``nan`` where no robot runs there."""
        level = self.grounds[0].held_speed
        return found.held_speed / level - 1.0 if level > _STANDS else math.nan

    def met(self, found: GroundTrials) -> bool:
        """Whether every trial stayed upright and the loss is within its limit."""
        return not found.falls and self.change(found) >= -LARGEST_LOSS

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready numbers; what is not defined becomes null."""
        rows = [
            {
                "ground": found.name,
                "trials": found.trials,
                "upright": found.upright,
                "fall_reasons": found.falls,
                "held_speed_m_s": found.held_speed,
                "change": self.change(found),
                "met": self.met(found),
            }
            for found in self.grounds
        ]
        return json_ready(
            {
                "top_speed_command_m_s": self.settings.top_speed,
                "slope": self.settings.slope,
                "roughness_m": self.settings.roughness,
                "largest_loss": LARGEST_LOSS,
                "grounds": rows,
            }
        )


def compare_grounds(
    pool: TrialPool, settings: GroundSettings, progress: Progress = lambda *_: None
) -> GroundResult:
    """Run every trial; errors as in ``run_cases``."""
    cases = settings.cases()
    runs, found = run_cases(pool, cases, progress), list[GroundTrials]()
    for name in dict.fromkeys(case.group for case in cases):
        here = of_group(runs, name)
        falls = tuple(run.fall_reason for run in here if not run.upright)
        held = mean(held_speeds(here))
        found.append(GroundTrials(name=name, trials=len(here), held_speed=held, falls=falls))
    return GroundResult(settings=settings, grounds=tuple(found))
