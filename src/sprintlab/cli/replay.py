"""``sprintlab replay``: a recorded run as one interactive 3D page."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from sprintlab.api.replay import replay
from sprintlab.cli.output import arguments, show


@dataclass(frozen=True, kw_only=True)
class Replay:
    """Write recorded runs as one HTML file: orbit, scrub, slow motion, speed and torque; opens offline.

    Several runs start together on neighbouring lanes, with the gaps between them as they run.

    Attributes:
        run_folders: folders of races, or recorded trajectories (.npz); the newest race when left out.
        world_record: also a runner at the pace of the men's world record over the distance (100 or 400 m).
        names: what to call the runs, in their order; the policies' names when left out.
        robot: a robot's name or parameter table (.toml); what the race's result.json says when left out.
        out: the page to write; replay.html (several runs: ghosts.html) beside the first when left out.
        json: print JSON only.
    """

    run_folders: tyro.conf.Positional[tuple[Path, ...]] = ()
    world_record: tyro.conf.FlagCreatePairsOff[bool] = False
    names: tuple[str, ...] = ()
    robot: str | None = None
    out: Path | None = None
    json: tyro.conf.FlagCreatePairsOff[bool] = False

    def run(self) -> int:
        """Write the page; raises ``SprintlabError`` when there is no recording or it is another robot's."""
        show(replay(**arguments(self)), self, soft_wrap=True)
        return 0
