"""``sprintlab robustness``: many sprints with everything randomized at once."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from sprintlab.api.robustness import robustness
from sprintlab.cli.output import measure


@dataclass(frozen=True, kw_only=True)
class Robustness:
    """Run many sprints with everything randomized at once: how many stay upright, what they hold.

    Friction, payload, centre of mass, strength, bus voltage, delay, sensor noise, joint offsets, pushes and
    foot pads are drawn anew for every sprint; a few more sprints randomize one of them at a time and tell
    what each costs. Every sprint is kept in a file of its own: run the same command again after a kill, or
    with more trials, and it goes on where it was.

    Attributes:
        policy: a policy file, or the name of a policy that comes with the package.
        trials: sprints with everything randomized at once.
        cause_trials: sprints of each cause alone, and of the nominal robot.
        robot: a robot's name, or a parameter table of one's own (.toml); the policy's when left out.
        top_speed: speed asked for [m/s]; when left out, a search finds that at which most is held.
        distance: of a sprint [m].
        seed: of the first sprint; the next one has the next seed.
        workers: processes; one a core when left out.
        out: folder of the sprints; runs/robustness-<policy> when left out.
        figure: picture to draw (.png, .pdf or .svg); none when left out.
        json: print JSON only.
    """

    policy: tyro.conf.Positional[str] = "sprint"
    trials: int = 1000
    cause_trials: int = 20
    robot: str | None = None
    top_speed: float | None = None
    distance: float = 100.0
    seed: int = 0
    workers: int | None = None
    out: Path | None = None
    figure: Path | None = None
    json: tyro.conf.FlagCreatePairsOff[bool] = False

    def run(self) -> int:
        """Run what is missing and print the numbers.

        Raises:
            SprintlabError: policy, robot, folder or a setting is refused, or the simulation failed.
        """
        measure(lambda out, **options: robustness(folder=out, **options), self)
        return 0
