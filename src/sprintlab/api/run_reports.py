"""A log of a run on a robot as figures, numbers and one page, beside its simulation."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import RenderableType

from sprintlab.api.policies import known_policy, known_robot, policy_path
from sprintlab.api.processes import Progress
from sprintlab.api.tables import Printed, plain_table, written_for
from sprintlab.core.arguments import checked

if TYPE_CHECKING:
    from sprintlab.evaluation.results import TrialResult
    from sprintlab.evaluation.run_report import TrackRun
    from sprintlab.robots import RobotDescription


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class RunReport(Printed):
    """A run on a robot in numbers, beside its simulation; figures and page lie in a folder."""

    numbers: dict[str, Any]
    """As in ``result.json``."""
    folder: Path | None = None
    """With ``report.html`` and the figures; ``None`` where the disk had no room for it."""

    def to_dict(self) -> dict[str, Any]:
        """The numbers and the folder."""
        return {**self.numbers, "folder": None if self.folder is None else str(self.folder)}

    def tables(self) -> Iterator[RenderableType]:
        """Robot and simulation side by side, the faults, and where the page lies."""
        from sprintlab.evaluation.run_report import number_rows

        columns = ("robot", "simulation")
        rows = [tuple(row.values()) for row in number_rows(self.numbers)]
        rows += [(f"fault {name}", str(count), "", "") for name, count in self.numbers["faults"].items()]
        yield plain_table("Run", "quantity", *columns, "unit", numbers=columns, rows=rows)
        if self.folder is not None:
            yield f"\nreport: {self.folder / 'report.html'}"


@checked
def report_run(
    log: Path,
    folder: Path | None = None,
    *,
    robot: str | None = None,
    policy: str | None = None,
    distance: float = 100.0,
    simulate: bool = True,
    progress: Progress = lambda what, share: None,
) -> RunReport:
    """Draw a log of ``sprintlab run``, with the same commands in simulation beside it.

    Args:
        log: the log (.mcap).
        folder: result folder, which must not exist; runs/report-<date>-<time> when left out.
        robot: a robot's name, or a parameter table of one's own (.toml); the log's when left out.
        policy: the policy to simulate; the log's when left out, if it comes with the package.
        distance: length of the sprint [m].
        simulate: whether the simulation stands beside the run; without it the log is drawn alone.
        progress: called with what is being done.

    Raises:
        SprintlabError: the log, the robot, the policy or the folder is refused.
        UnwrittenError: the disk has no room for the report any more; its ``found`` is the report's numbers.
    """
    from sprintlab.core.checks import check_positive
    from sprintlab.core.files import check_new_folder, default_folder

    check_positive("distance", distance, "m")
    place = folder or default_folder(prefix="report")
    check_new_folder(place)
    from sprintlab.api.log_trial import logged_run
    from sprintlab.deployment.log import read_log
    from sprintlab.evaluation.run_report import run_numbers
    from sprintlab.robots import load_robot

    progress("reading the log", None)
    record = read_log(log)
    described = load_robot(robot or known_robot(record.facts["robot"], log.name))
    told = record.facts.get("policy", "sprint")
    chosen = policy or known_policy(told, log.name) if simulate else None
    run = logged_run(record, described, distance)
    simulation = None if chosen is None else _simulate(run, described, chosen, progress)
    numbers = {**run_numbers(run, simulation), "faults": run.faults, "facts": record.facts}
    found = RunReport(numbers=numbers)
    with written_for(found):
        _write(place, run, simulation, described, numbers, progress)
    return replace(found, folder=place)


def _write(
    folder: Path,
    run: TrackRun,
    simulation: TrialResult | None,
    robot: RobotDescription,
    numbers: dict[str, Any],
    progress: Progress,
) -> None:
    from sprintlab.core.files import (
        atomic_directory,
        atomic_write_bytes,
        atomic_write_json,
        atomic_write_text,
    )
    from sprintlab.evaluation.run_report import make_run_pictures, render_run_report

    pictures = make_run_pictures(
        run, simulation, robot, lambda what: progress(f"drawing: {what.lower()}", None)
    )
    facts = [*numbers["facts"].items()]
    facts += [(f"fault {name}", str(count)) for name, count in numbers["faults"].items()]
    with atomic_directory(folder) as temporary:
        for picture in pictures:
            atomic_write_bytes(temporary / f"{picture.name}.png", picture.light)
        atomic_write_json(temporary / "result.json", numbers)
        atomic_write_text(temporary / "report.html", render_run_report(run, simulation, pictures, facts))


def _simulate(run: TrackRun, robot: RobotDescription, policy: str, progress: Progress) -> TrialResult:
    from sprintlab.control import load_policy
    from sprintlab.evaluation.run_report import simulate_commands

    progress("simulating the same commands", None)
    loaded = load_policy(policy_path(policy))
    return simulate_commands(loaded, robot, run.command_time, run.command[:, 0], run.trial.hold_interval)
