"""What slopes and rough ground cost a policy: speed held against that on level ground, and falls."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from sprintlab.core.checks import check_positive, check_range
from sprintlab.core.json_values import json_ready
from sprintlab.evaluation.protocol import ProtocolSettings
from sprintlab.evaluation.sweep import Case, Run, held_speeds, mean, of_group
from sprintlab.plant import Ground, PlantOptions

LARGEST_LOSS = 0.15
"""Share of the speed held on level ground that slopes and rough ground may cost."""

_STANDS = 0.1  # who holds no more does not run [m/s]


def ground_cases(
    top_speed: float, trials: int, slope: float, roughness: float, plant: PlantOptions
) -> list[Case]:
    """The protocol's seeded trials on each ground, level ground first; the same draws on each.

    ``slope`` is rise over run, run up and down; ``roughness`` the greatest height above and below the mean
    [m], drawn anew for each trial. The plant's own ground is replaced.

    Raises:
        InvalidValueError: a number is out of range.
    """
    check_range("ground.top_speed", top_speed, 0.5, 16.0, "m/s")
    check_range("ground.trials", trials, 1, 10_000)
    check_positive("ground.slope", slope)
    check_positive("ground.roughness", roughness, "m")
    protocol = ProtocolSettings(trials=trials, required=1, plant=plant)
    drawn = list(enumerate(protocol.requests(top_speed, self_paced=False)))
    kinds = {
        "level": lambda seed: Ground(),
        "uphill": lambda seed: Ground(slope=slope),
        "downhill": lambda seed: Ground(slope=-slope),
        "rough": lambda seed: Ground(roughness=roughness, seed=seed),
    }
    return [
        Case(group=kind, request=replace(request, plant=replace(plant, ground=make(seed))))
        for kind, make in kinds.items()
        for seed, request in drawn
    ]


def ground_numbers(runs: Sequence[Run]) -> dict[str, Any]:
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
            "largest_loss": LARGEST_LOSS,
            "grounds": rows,
        }
    )
