"""What slopes and rough ground cost a policy: speed held against that on level ground, and falls."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from sprintlab.core.checks import check_positive, check_range
from sprintlab.core.json_values import json_ready
from sprintlab.evaluation.pool import TrialPool
from sprintlab.evaluation.protocol import ProtocolSettings
from sprintlab.evaluation.results import TrialResult
from sprintlab.evaluation.trial import TrialRequest
from sprintlab.plant import Ground, PlantOptions

LARGEST_LOSS = 0.15
"""Share of the speed held on level ground that slopes and rough ground may cost."""

_STANDS = 0.1  # who holds no more does not run [m/s]


@dataclass(frozen=True, kw_only=True)
class GroundSettings:
    """What is run.

    Attributes:
        top_speed: v* of every profile [m/s].
        trials: seeded trials on each ground, the protocol's; on rough ground each has heights of its own.
        slope: rise over run of the slopes, run up and down.
        roughness: greatest height of the rough ground above and below its mean [m].
        hold: duration of each hold [s].
        plant: how the robot is simulated; its ground is replaced.

    Raises:
        InvalidValueError: a number is out of range.
    """

    top_speed: float
    trials: int = 3
    slope: float = 0.05
    roughness: float = 0.02
    hold: float = 10.0
    plant: PlantOptions = field(default_factory=PlantOptions)

    def __post_init__(self) -> None:
        check_range("ground.top_speed", self.top_speed, 0.5, 16.0, "m/s")
        check_range("ground.trials", self.trials, 1, 10_000)
        check_positive("ground.slope", self.slope)
        check_positive("ground.roughness", self.roughness, "m")
        Ground(slope=self.slope, roughness=self.roughness)

    def grounds(self) -> dict[str, tuple[Ground, ...]]:
        """The ground of every trial, by the name of the kind."""
        kinds = {
            "level": Ground(),
            "uphill": Ground(slope=self.slope),
            "downhill": Ground(slope=-self.slope),
        }
        even = {name: (ground,) * self.trials for name, ground in kinds.items()}
        rough = tuple(Ground(roughness=self.roughness, seed=seed) for seed in range(self.trials))
        return {**even, "rough": rough}

    def requests(self) -> list[TrialRequest]:
        """Every trial, in the order of ``grounds``; the same draws on each ground."""
        protocol = ProtocolSettings(trials=self.trials, required=1, hold=self.hold, plant=self.plant)
        drawn = protocol.requests(self.top_speed, self_paced=False)
        return [
            replace(request, plant=replace(self.plant, ground=ground), keep_trajectory=False)
            for grounds in self.grounds().values()
            for request, ground in zip(drawn, grounds, strict=True)
        ]


@dataclass(frozen=True, kw_only=True)
class GroundTrials:
    """The trials on one kind of ground.

    Attributes:
        name: ``"level"``, ``"uphill"``, ``"downhill"`` or ``"rough"``.
        trials: how many ran.
        held_speed: along the ground, mean of the upright [m/s]; ``nan`` where all fell.
        falls: the reason of each fall.
    """

    name: str
    trials: int
    held_speed: float
    falls: tuple[str, ...] = ()

    @property
    def upright(self) -> int:
        """How many did not fall."""
        return self.trials - len(self.falls)


@dataclass(frozen=True, kw_only=True)
class GroundResult:
    """All trials of one policy.

    Attributes:
        settings: what was run.
        grounds: level ground first.
    """

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
        settings = self.settings
        return json_ready(
            {
                "top_speed_command_m_s": settings.top_speed,
                "slope": settings.slope,
                "roughness_m": settings.roughness,
                "largest_loss": LARGEST_LOSS,
                "grounds": rows,
            }
        )


def compare_grounds(
    pool: TrialPool,
    settings: GroundSettings,
    progress: Callable[[str, float], None] = lambda *_: None,
) -> GroundResult:
    """Run every trial.

    Args:
        pool: policy, robot and processes.
        settings: what is run.
        progress: called after every trial with the kind of ground and the share done.

    Raises:
        SimulationError: as ``run_trial``.
    """
    requests, names = settings.requests(), tuple(settings.grounds())
    speeds: dict[str, list[float]] = {name: [] for name in names}
    falls: dict[str, list[str]] = {name: [] for name in names}
    for index, result in enumerate(pool.stream(requests)):
        name = names[index // settings.trials]
        trial = result if isinstance(result, TrialResult) else result.trial
        if trial.fall_reason:
            falls[name].append(trial.fall_reason)
        else:
            speeds[name].append(trial.metrics.held_speed)
        progress(name, (index + 1) / len(requests))
    return GroundResult(
        settings=settings,
        grounds=tuple(
            GroundTrials(
                name=name,
                trials=settings.trials,
                held_speed=float(np.mean(held)) if held else math.nan,
                falls=tuple(falls[name]),
            )
            for name, held in speeds.items()
        ),
    )
