"""``sprintlab limit``: how fast a robot could run at most, before any training."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from sprintlab.api.limits import limit
from sprintlab.cli.output import measure


@dataclass(frozen=True, kw_only=True)
class Limit:
    """Estimate from above how fast a robot can run, from its motors and legs alone.

    Attributes:
        robot: name of a robot, or the path of its folder or table.
        figure: picture to draw (.png, .pdf or .svg); none when left out.
        factors: factors on bus voltage, gear ratio, leg length and mass; none: no sensitivities.
        quick: only the limit and its stride: no causes, no sensitivities.
        starts: random strides to begin from; more find a little more.
        max_stride: highest stride frequency that counts [Hz]; what the motors allow when left out.
        min_duty: lowest share of a stride in which a foot stands; what the motors allow when left out.
        seed: of the random strides.
        results: folder whose result.json files say what trained policies reach.
        json: print JSON only.
    """

    robot: tyro.conf.Positional[str] = "bp2"
    figure: Path | None = None
    factors: tuple[float, ...] = (0.9, 1.1)
    quick: tyro.conf.FlagCreatePairsOff[bool] = False
    starts: int = 6
    max_stride: float | None = None
    min_duty: float | None = None
    seed: int = 0
    results: Path = Path("results")
    json: tyro.conf.FlagCreatePairsOff[bool] = False

    def run(self) -> int:
        """Print the estimate; raises ``SprintlabError`` for an unknown robot, a bad option, or no SciPy."""
        measure(limit, self)
        return 0
