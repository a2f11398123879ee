"""``sprintlab report``: a log of a run as figures and one HTML page, beside its simulation."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro

from sprintlab.api.run_reports import report_run
from sprintlab.cli.output import plain_table, print_json, progress_bar, stdout_console


@dataclass(frozen=True, kw_only=True)
class Report:
    """Draw a log of ``sprintlab run``, with the same commands in simulation beside it.

    Attributes:
        log: the log (.mcap).
        robot: a robot's name, or a parameter table of one's own (.toml); the log's when left out.
        policy: the policy to simulate; the log's when left out.
        out: result folder; runs/report-<date>-<time> when left out.
        distance: of the sprint [m].
        no_simulation: draw the log alone.
        json: print JSON only.
    """

    log: tyro.conf.Positional[Path]
    robot: str | None = None
    policy: str | None = None
    out: Path | None = None
    distance: float = 100.0
    no_simulation: tyro.conf.FlagCreatePairsOff[bool] = False
    json: tyro.conf.FlagCreatePairsOff[bool] = False

    def run(self) -> int:
        """Read, simulate, draw, print.

        Raises:
            SprintlabError: the log, the robot, the policy or the folder is refused.
        """
        with progress_bar(quiet=self.json) as report:
            numbers, folder = report_run(
                self.log,
                self.out,
                robot=self.robot,
                policy=self.policy,
                distance=self.distance,
                simulate=not self.no_simulation,
                progress=report,
            )
        if self.json:
            print_json({**numbers, "folder": str(folder)})
        else:
            _print_numbers(numbers, folder)
        return 0


def _print_numbers(numbers: dict[str, Any], folder: Path) -> None:
    from sprintlab.evaluation.run_report import number_rows

    table = plain_table("Run", "quantity", "robot", "simulation", "unit", numbers=("robot", "simulation"))
    for row in number_rows(numbers):
        table.add_row(row["name"], row["robot"], row["simulation"], row["unit"])
    for name, count in numbers["faults"].items():
        table.add_row(f"fault {name}", str(count), "", "")
    console = stdout_console()
    console.print(table)
    console.print(f"\nreport: {folder / 'report.html'}", soft_wrap=True)
