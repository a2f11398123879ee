"""``sprintlab race``: the main job."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from sprintlab.api.drive import DriveOptions
from sprintlab.api.races import Race as RaceFound
from sprintlab.api.races import race
from sprintlab.cli.output import print_json, progress_bar, stderr_console, stdout_console
from sprintlab.core.files import default_folder


@dataclass(frozen=True, kw_only=True)
class Race:
    """Run a policy over 100 m and through the protocol at its top speed; write a report.

    Attributes:
        policy: a policy file, or the name of a policy that comes with the package.
        robot: a robot's name, or a parameter table of one's own (.toml); the policy's when left out.
        out: result folder; runs/race-<date>-<time> when left out.
        top_speed: speed of the profile [m/s]; when left out, a search finds that at which most is held.
        distance: of the sprint [m].
        engine: mujoco, drake (the second engine, extra drake), or both: the race in MuJoCo, and its sprint
            and raw trials once more in Drake.
        trials: seeded trials each way of giving the command.
        seed: decides joint noise, friction and payload of every trial.
        workers: processes; one a core when left out.
        step_check: also compare 1 ms with 0.25 ms simulation steps.
        no_video: do not render the MP4.
        json: print JSON only.
        drive: motor model, battery and heat.
    """

    policy: tyro.conf.Positional[str] = "sprint"
    robot: str | None = None
    out: Path | None = None
    top_speed: float | None = None
    distance: float = 100.0
    engine: Literal["mujoco", "drake", "both"] = "mujoco"
    trials: int = 3
    seed: int = 0
    workers: int | None = None
    step_check: bool = False
    no_video: bool = False
    json: bool = False
    drive: DriveOptions = DriveOptions()

    def run(self) -> int:
        """Run the race and print its numbers; raises ``SprintlabError`` where ``race`` does."""
        with progress_bar(quiet=self.json) as report:
            report("loading", None)
            found = race(
                self.policy,
                robot=self.robot,
                top_speed=self.top_speed,
                distance=self.distance,
                engine=self.engine,
                trials=self.trials,
                seed=self.seed,
                drive=self.drive,
                workers=self.workers,
                step_check=self.step_check,
                folder=self.out or default_folder(),
                video=not self.no_video,
                progress=lambda what: report(what, None),
            )
        folder = found.folder or Path()
        if self.json:
            print_json({**json.loads((folder / "result.json").read_text()), "folder": str(folder)})
        else:
            _print(found, folder)
        return 0


def _print(found: RaceFound, folder: Path) -> None:
    console = stdout_console()
    console.print(found)
    console.print(f"\nreport: {folder / 'report.html'}", soft_wrap=True)
    console.print(f"replay: {folder / 'replay.html'}", soft_wrap=True)
    if found.video_message:
        stderr_console().print(found.video_message, soft_wrap=True)
    else:
        console.print(f"video: {folder / 'sprint.mp4'}", soft_wrap=True)
