"""``sprintlab replay``: a recorded run as one interactive 3D page."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from sprintlab.cli.output import print_json, stdout_console


@dataclass(frozen=True, kw_only=True)
class Replay:
    """Write a recorded run as one HTML file: orbit, scrub, slow motion, speed and torque; opens offline.

    Attributes:
        run_folder: folder of a race, or a recorded trajectory (.npz); the newest race in runs/ when left out.
        robot: a robot's name or parameter table (.toml); what the race's result.json says when left out.
        out: the page to write; replay.html beside the trajectory when left out.
        json: print JSON only.
    """

    run_folder: tyro.conf.Positional[Path | None] = None
    robot: str | None = None
    out: Path | None = None
    json: tyro.conf.FlagCreatePairsOff[bool] = False

    def run(self) -> int:
        """Write the page; raises ``SprintlabError`` when there is no recording or it is another robot's."""
        from sprintlab.api.policies import default_robot
        from sprintlab.api.replay import race_result, replay_text, trajectory_path
        from sprintlab.robots import load_robot
        from sprintlab.viewer.replay import load_arrays, write_replay

        trajectory = trajectory_path(self.run_folder)
        result = race_result(trajectory.with_name("result.json"))
        arrays = load_arrays(trajectory)
        page = self.out or trajectory.with_name("replay.html")
        robot = load_robot(self.robot or str(result.get("robot") or default_robot()))
        write_replay(page, arrays, robot, replay_text(trajectory, robot.name, result))
        if self.json:
            print_json({"page": str(page), "bytes": page.stat().st_size})
        else:
            stdout_console().print(f"replay: {page}", soft_wrap=True)
        return 0
