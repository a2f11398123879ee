"""``sprintlab race``: the main job."""

from __future__ import annotations

import json
import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tyro

from sprintlab.api.drive import DriveOptions
from sprintlab.api.policies import policy_path, robot_for
from sprintlab.api.replay import write_race_replay
from sprintlab.api.search import protocol_settings
from sprintlab.cli.output import plain_table, print_json, progress_bar, stderr_console, stdout_console

if TYPE_CHECKING:
    from rich.table import Table

    from sprintlab.evaluation.race_files import RaceFiles


@dataclass(frozen=True, kw_only=True)
class Race:
    """Run a policy over 100 m and through the protocol at its top speed; write a report.

    Attributes:
        policy: a policy file, or the name of a policy that comes with the package.
        robot: a robot's name, or a parameter table of one's own (.toml); the policy's when left out.
        out: result folder; runs/race-<date>-<time> when left out.
        top_speed: speed of the profile [m/s]; when left out, a search finds that at which most is held.
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
    trials: int = 10
    seed: int = 0
    workers: int | None = None
    step_check: tyro.conf.FlagCreatePairsOff[bool] = False
    no_video: tyro.conf.FlagCreatePairsOff[bool] = False
    json: tyro.conf.FlagCreatePairsOff[bool] = False
    drive: tyro.conf.FlagCreatePairsOff[DriveOptions] = DriveOptions()

    def run(self) -> int:
        """Run the race and print its numbers; raises ``SprintlabError`` as ``run_race`` does."""
        with progress_bar(quiet=self.json) as report:
            report("loading", None)
            policy = policy_path(self.policy)
            robot = robot_for(policy, self.robot)
            files = self._race(policy, robot, lambda what: report(what, None))
            report("writing the replay", None)
            write_race_replay(files.folder, robot)
        if self.json:
            print_json(
                {**json.loads((files.folder / "result.json").read_text()), "folder": str(files.folder)}
            )
            return 0
        _print_result(files)
        return 0

    def _race(self, policy: Path, robot: str, progress: Any) -> RaceFiles:
        from sprintlab.evaluation.race_files import run_race

        return run_race(
            policy,
            robot,
            self.out,
            top_speed=self.top_speed,
            settings=protocol_settings(self.trials, self.seed, plant=self.drive.plant()),
            step_check=self.step_check,
            workers=self.workers,
            video=not self.no_video,
            command_line=shlex.join(["sprintlab", *sys.argv[1:]]),
            progress=progress,
        )


def result_table(result: Any) -> Table:
    """The numbers of a race, raw beside self-paced."""
    from sprintlab.evaluation.quantities import QUANTITIES
    from sprintlab.evaluation.report_text import number, sprint_text

    raw, paced = result.raw, result.self_paced
    title = f"{result.robot}, policy {result.policy}, command up to {result.top_speed:g} m/s"
    table = plain_table(title, "quantity", "raw", "self-paced", "unit", numbers=("raw", "self-paced"))
    distance = f"time over {result.sprint.distance:g} m"
    table.add_row(distance, sprint_text(result.sprint), sprint_text(result.sprint_self_paced), "s")
    for item in QUANTITIES:
        values = (number(group.mean(item.field), item.digits) for group in (raw, paced))
        table.add_row(item.label, *values, item.unit)
    table.add_row("falls", *(f"{group.falls} of {len(group.trials)}" for group in (raw, paced)), "")
    table.add_row("time on the envelope, mean joint", *(_share(group, "mean") for group in (raw, paced)), "%")
    table.add_row(
        "time on the envelope, busiest joint", *(_share(group, "max") for group in (raw, paced)), "%"
    )
    return table


def audit_table(audit: Any) -> Table:
    """The exploit audit, one row an exploit."""
    from sprintlab.evaluation.report_text import audit_limit, audit_value, audit_verdict

    table = plain_table(
        f"Exploit audit: {audit_verdict(audit)}",
        "what",
        "measured",
        "limit",
        "",
        numbers=("measured", "limit"),
    )
    for item in audit.items:
        values = (audit_value(item.value, item.unit), audit_limit(item))
        table.add_row(item.name, *values, "[green]pass[/]" if item.passed else "[bold red]FAIL[/]")
    return table


def _share(group: Any, kind: str) -> str:
    import numpy as np

    from sprintlab.evaluation.report_text import number

    values = 100 * np.asarray(group.mean("envelope_share"), dtype=float)
    return number(float(getattr(values, kind)()), 1)


def _print_result(files: RaceFiles) -> None:
    console = stdout_console()
    console.print(result_table(files.result))
    console.print()
    console.print(audit_table(files.result.audit))
    for note in files.result.notes:
        console.print(note)
    console.print(f"\nreport: {files.folder / 'report.html'}", soft_wrap=True)
    console.print(f"replay: {files.folder / 'replay.html'}", soft_wrap=True)
    if files.video_message:
        stderr_console().print(files.video_message, soft_wrap=True)
    else:
        console.print(f"video: {files.folder / 'sprint.mp4'}", soft_wrap=True)
