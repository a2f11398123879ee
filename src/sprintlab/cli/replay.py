"""``sprintlab replay``: a recorded run as one interactive 3D page."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import tyro

from sprintlab.api.policies import default_robot
from sprintlab.api.replay import race_result, record_pace, replay_text, sprint_of, trajectory_path
from sprintlab.cli.output import print_json, stdout_console
from sprintlab.core.errors import InvalidValueError


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
        from sprintlab.viewer.replay import write_replay

        paths = [trajectory_path(run) for run in self.run_folders or (None,)]
        if self.names and len(self.names) != len(paths):
            raise InvalidValueError("names", " ".join(self.names), f"one name for each of {len(paths)} runs")
        results = [race_result(path.with_name("result.json")) for path in paths]
        pace = record_pace(sprint_of(results[0])[1]) if self.world_record else None
        runs = [self._run(index, path, results[index]) for index, path in enumerate(paths)]
        text = replay_text(paths[0], runs[0].robot.name, results[0], runs[0].name)
        alone = len(runs) == 1 and pace is None
        if not alone:
            names = [*(run.name for run in runs), *(["the world record"] if pace else [])]
            text = replace(text, title=" against ".join(names), subtitle=f"{text.distance:g} m")
        page = self.out or paths[0].with_name("replay.html" if alone else "ghosts.html")
        write_replay(page, runs[0].arrays, runs[0].robot, text, runs[1:], pace)
        if self.json:
            print_json({"page": str(page), "bytes": page.stat().st_size})
        else:
            stdout_console().print(f"replay: {page}", soft_wrap=True)
        return 0

    def _run(self, index: int, path: Path, result: dict[str, Any]) -> Any:
        from sprintlab.robots import load_robot
        from sprintlab.viewer.replay import ReplayRun, load_arrays

        robot = load_robot(self.robot or str(result.get("robot") or default_robot()))
        name = self.names[index] if self.names else str(result.get("policy", path.parent.name))
        return ReplayRun(arrays=load_arrays(path), robot=robot, name=name)
