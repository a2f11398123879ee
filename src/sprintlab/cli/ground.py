"""``sprintlab ground``."""

from __future__ import annotations

from dataclasses import dataclass

import tyro

from sprintlab.api.drive import DriveOptions
from sprintlab.api.grounds import ground
from sprintlab.cli.output import measure


@dataclass(frozen=True, kw_only=True)
class Ground:
    """Measure what slopes and rough ground cost a policy: falls, and speed held against level ground.

    Attributes:
        policy: a policy file, or the name of a policy that comes with the package.
        top_speed: commanded speed [m/s].
        trials: seeded trials on each ground; on rough ground each has heights of its own.
        slope: rise over run, run up and down: 0.05 is 5 %.
        roughness: greatest height of the rough ground above and below its mean [m].
        robot: a robot's name, or a parameter table of one's own (.toml); the policy's when left out.
        workers: processes; one a core when left out.
        json: print JSON only.
        drive: motor model, battery and heat.
    """

    policy: tyro.conf.Positional[str]
    top_speed: float = 10.0
    trials: int = 3
    slope: float = 0.05
    roughness: float = 0.02
    robot: str | None = None
    workers: int | None = None
    json: tyro.conf.FlagCreatePairsOff[bool] = False
    drive: tyro.conf.FlagCreatePairsOff[DriveOptions] = DriveOptions()

    def run(self) -> int:
        """Run every trial, print the table.

        Raises:
            SprintlabError: the policy, the robot or a setting is refused, or the simulation failed.
        """
        measure(ground, self)
        return 0
