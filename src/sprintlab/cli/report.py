"""``sprintlab report``: a log of a run as figures and one HTML page, beside its simulation."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tyro

from sprintlab.api.policies import policy_path
from sprintlab.cli.output import plain_table, print_json, progress_bar, stdout_console

if TYPE_CHECKING:
    from collections.abc import Callable

    from sprintlab.api.log_trial import LoggedRun
    from sprintlab.deployment.log import RunRecord
    from sprintlab.evaluation.results import TrialResult
    from sprintlab.evaluation.run_report import TrackRun


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
        from sprintlab.core.checks import check_positive
        from sprintlab.core.errors import SprintlabError
        from sprintlab.deployment.log import read_log
        from sprintlab.evaluation.race_files import default_folder

        check_positive("distance", self.distance, "m")
        if self.out is not None and self.out.exists():
            raise SprintlabError(f"{self.out} exists already; choose another folder for the results")
        with progress_bar(quiet=self.json) as report:
            report("reading the log", None)
            record = read_log(self.log)
            numbers, folder = self._draw(record, self.out or default_folder(prefix="report"), report)
        if self.json:
            print_json({**numbers, "folder": str(folder)})
        else:
            _print_numbers(numbers, folder)
        return 0

    def _draw(
        self, record: RunRecord, folder: Path, report: Callable[[str, float | None], None]
    ) -> tuple[dict[str, Any], Path]:
        from sprintlab.api.log_trial import logged_run
        from sprintlab.core.files import (
            atomic_directory,
            atomic_write_bytes,
            atomic_write_json,
            atomic_write_text,
        )
        from sprintlab.evaluation.run_report import make_run_pictures, render_run_report, run_numbers
        from sprintlab.robots import load_robot

        robot = load_robot(self.robot or record.facts["robot"])
        logged = logged_run(record, robot)
        run = _track_run(logged, self.distance)
        simulation = None if self.no_simulation else self._simulate(record, logged, robot, report)
        numbers = {**run_numbers(run, simulation), "faults": logged.faults, "facts": record.facts}
        pictures = make_run_pictures(
            run, simulation, robot, lambda what: report(f"drawing: {what.lower()}", None)
        )
        facts = [*record.facts.items(), *((f"fault {name}", str(n)) for name, n in logged.faults.items())]
        with atomic_directory(folder) as temporary:
            for picture in pictures:
                atomic_write_bytes(temporary / f"{picture.name}.png", picture.light)
            atomic_write_json(temporary / "result.json", numbers)
            page = render_run_report(run, simulation, pictures, facts)
            atomic_write_text(temporary / "report.html", page)
        return numbers, folder

    def _simulate(
        self, record: RunRecord, logged: LoggedRun, robot: Any, report: Callable[[str, float | None], None]
    ) -> TrialResult:
        from sprintlab.control import load_policy
        from sprintlab.evaluation.run_report import simulate_commands

        report("simulating the same commands", None)
        policy = load_policy(policy_path(self.policy or record.facts.get("policy", "sprint")))
        hold = logged.trial.hold_interval
        return simulate_commands(policy, robot, logged.command_time, logged.command[:, 0], hold)


def _track_run(logged: LoggedRun, distance: float) -> TrackRun:
    from sprintlab.evaluation.run_report import TrackRun

    return TrackRun(
        trial=logged.trial,
        fix_time=logged.fix_time,
        fix_speed=logged.fix_speed,
        fix_way=logged.fix_way,
        command_time=logged.command_time,
        command=logged.command,
        time_over_distance=logged.time_over(distance),
        distance=distance,
    )


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
