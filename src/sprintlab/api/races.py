"""``race``: 100 m and the protocol at a policy's top speed, as one object."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from sprintlab.api.drive import DriveOptions
from sprintlab.api.policies import PolicyChoice, RobotChoice, policy_path, robot_for
from sprintlab.api.processes import Progress, leave_to_the_parent
from sprintlab.api.search import protocol_settings
from sprintlab.api.tables import Drawn, in_notebook, plain_table, styled, written_for
from sprintlab.core.arguments import checked
from sprintlab.core.checks import check_range
from sprintlab.core.errors import RobotModelError, UnwrittenError
from sprintlab.core.files import check_writable, default_folder, reserved_directory

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sprintlab.evaluation.results import AuditReport, RaceResult
    from sprintlab.robots import RobotDescription

FIGURES = ("sprint", "speed", "torque_speed", "gait", "base_rates", "power")
"""What ``Race.plot`` draws."""


HIGHEST_SPEED = 40.0
"""Highest speed that a robot is asked for [m/s]."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Race(Drawn):
    """What a race found; prints as a table, draws itself, writes its report.

    Attributes:
        result: every trial and its numbers.
        policy: the policy file.
        robot: name, folder or table of the robot.
        folder: where the report lies; ``None`` where none was written.
        facts: what somebody needs to repeat the race, as the report tells it.
        video_message: why the report has no video; empty where it has one.
        robot_fingerprint: of the robot that ran; empty where it is not known.
    """

    result: RaceResult
    policy: Path
    robot: str
    folder: Path | None = None
    facts: dict[str, str] = field(default_factory=dict)
    video_message: str = ""
    robot_fingerprint: str = ""

    def to_dict(self) -> dict[str, Any]:
        """The numbers as plain values, keys with units, as in ``result.json``; what is undefined is None."""
        reported = {} if self.folder is None else {"facts": self.facts, "folder": str(self.folder)}
        return {**self.result.to_dict(), **reported}

    def tables(self) -> Iterator[RenderableType]:
        """The audit, what failed of it, raw beside self-paced, remarks, and where the report lies."""
        from sprintlab.evaluation.report_text import audit_failure

        yield audit_table(self.result.audit)
        for item in self.result.audit.failed:
            yield Text(f"audit failed: {audit_failure(item)}", style="bold red")
        yield from _falls(self.result)
        yield ""
        yield result_table(self.result)
        yield from _engines(self.result)
        yield from self.result.notes
        if self.folder is not None:
            yield f"\nreport: {self.folder / 'report.html'}"
            yield f"replay: {self.folder / 'replay.html'}"
            yield self.video_message or f"video: {self.folder / 'sprint.mp4'}"

    def plot(self, figure: str = "speed") -> Figure:
        """One figure of the report.

        Args:
            figure: one of ``FIGURES``.

        Raises:
            InvalidValueError: there is no such figure.
            RobotModelError: the robot's table is gone, or another robot's now.
        """
        from sprintlab.core.checks import check_choice
        from sprintlab.core.theme import LIGHT
        from sprintlab.evaluation.report import planned_figures

        check_choice("figure", figure, FIGURES)
        draw = {name: draw for name, _, _, draw in planned_figures(self.result, _robot_that_ran(self))}
        return in_notebook(draw[figure](LIGHT))

    def report(self, folder: Path | str | None = None, *, video: bool = False) -> Path:
        """Write the report's folder: ``report.html``, ``replay.html``, ``result.json``, pictures, arrays.

        Args:
            folder: must not exist; ``runs/race-<date>-<time>`` when left out.
            video: also render an MP4 where that is possible.

        Returns:
            The page, ``report.html``.

        Raises:
            SprintlabError: the folder exists, or the disk refuses; nothing half-written is left.
        """
        with reserved_directory(Path(folder) if folder else default_folder()) as target:
            _written(self, target, video, lambda what, share: None)
        return target / "report.html"


@checked
def race(
    policy: PolicyChoice = "sprint",
    *,
    robot: RobotChoice = None,
    top_speed: float | None = None,
    distance: float = 100.0,
    engine: Literal["mujoco", "drake", "both"] = "mujoco",
    trials: int = 3,
    seed: int = 0,
    drive: DriveOptions | None = None,
    workers: int | None = None,
    step_check: bool = False,
    folder: Path | str | None = None,
    video: bool = False,
    progress: Progress = lambda what, share: None,
) -> Race:
    """Run a policy over 100 m and through the protocol at its top speed, raw and self-paced.

    Args:
        policy: a policy file, or the name of a policy that comes with the package.
        robot: a robot's name, or a parameter table of one's own (.toml); the policy's when left out.
        top_speed: of the profile [m/s]; when left out, a search finds that at which most is held.
        distance: of the sprint [m].
        engine: mujoco, drake (the second engine, extra drake), or both: the race in MuJoCo, and its sprint
            and raw trials once more in Drake.
        trials: seeded trials each way of giving the command.
        seed: decides joint noise, friction and payload of every trial.
        drive: motor model, battery and heat; the published numbers' when left out.
        workers: processes; one a core when left out.
        step_check: also compare 1 ms with 0.25 ms simulation steps.
        folder: for the report, which must not exist; when left out, the command line takes
            runs/race-<date>-<time>, and a program writes none.
        video: whether the report has an MP4, too; without, none is rendered.
        progress: called with what is being done.

    Raises:
        SprintlabError: the policy, the robot, the folder or a setting is refused, or the simulation failed.
        UnwrittenError: the disk has no room for the report any more; its ``found`` is the race.
    """
    leave_to_the_parent()
    _check_race(top_speed, seed, workers, folder)
    path = policy_path(policy)
    name = robot_for(path, robot)
    from sprintlab.plant import on_engine

    both = engine == "both"
    plant = on_engine((drive or DriveOptions()).plant(), "mujoco" if both else engine)
    settings = protocol_settings(trials, seed, plant=plant)
    from sprintlab.evaluation.race import evaluate_race
    from sprintlab.robots import load_robot, robot_fingerprint

    described = load_robot(name)
    with nullcontext() if folder is None else reserved_directory(Path(folder)) as target:
        progress("running trials", None)
        result = evaluate_race(
            path,
            described,
            top_speed=top_speed,
            distance=distance,
            settings=settings,
            step_check=step_check,
            second_engine="drake" if both else None,
            workers=workers,
            progress=progress,
        )
        fingerprint = robot_fingerprint(described)
        found = Race(result=result, policy=path, robot=name, robot_fingerprint=fingerprint)
        with written_for(found):
            return found if target is None else _written(found, target, video, progress)


def _check_race(top_speed: float | None, seed: int, workers: int | None, folder: Path | str | None) -> None:
    """Refuse before any work what no race can be run with. Raises ``SprintlabError``."""
    if top_speed is not None:
        check_range("top_speed", top_speed, 0.1, HIGHEST_SPEED, "m/s")
    if workers is not None:
        check_range("workers", workers, 1, 1024)
    check_range("seed", seed, 0, 2**32 - 1)
    if folder is not None:
        check_writable(folder)


def _written(found: Race, target: Path, video: bool, progress: Progress) -> Race:
    """The race with its report in a folder, and the 100 m as an interactive page beside it."""
    from sprintlab.api.replay import write_race_replay
    from sprintlab.evaluation.race_files import race_facts, write_race

    try:
        robot = _robot_that_ran(found)
    except RobotModelError as error:
        raise UnwrittenError(f"cannot write the report {target}: {error}") from error
    facts = race_facts(found.policy, found.result, command_line())
    message = write_race(
        target, found.result, robot, found.robot, facts, video, progress=lambda what: progress(what, None)
    )
    progress("writing the replay", None)
    write_race_replay(target, robot)
    return replace(found, folder=target, facts=facts, video_message=message)


def _robot_that_ran(found: Race) -> RobotDescription:
    """The robot of a race; its table may have been edited since.

    Raises:
        RobotModelError: the table cannot be read, or is another robot's: a picture would be of both.
    """
    from sprintlab.robots import load_robot, robot_fingerprint

    described = load_robot(found.robot)
    if found.robot_fingerprint not in ("", robot_fingerprint(described)):
        raise RobotModelError(f"robot {found.robot} has changed since the race began: run it again")
    return described


def command_line() -> str:
    """What was typed, for reports."""
    name = Path(sys.argv[0]).name or "python"
    return shlex.join([name.removesuffix(".py") if name == "__main__.py" else name, *sys.argv[1:]])


def result_table(result: RaceResult) -> Table:
    """The numbers of a race, raw beside self-paced."""
    from sprintlab.evaluation.report_text import result_rows

    title = f"{result.robot}, policy {result.policy}, command up to {result.top_speed:g} m/s"
    rows = [row[:4] for row in result_rows(result)]
    columns = ("quantity", "raw", "self-paced", "unit")
    return plain_table(title, *columns, numbers=columns[1:3], rows=rows)


def _falls(result: RaceResult) -> Iterator[str]:
    """Each fall: when, why, and what the supply had come to."""
    from sprintlab.evaluation.report_text import fall_text

    runs = [("sprint, raw", result.sprint.trial), ("sprint, self-paced", result.sprint_self_paced.trial)]
    for group, name in ((result.raw, "raw"), (result.self_paced, "self-paced")):
        runs += [(f"{name}, seed {trial.settings.seed}", trial) for trial in group.trials]
    for name, trial in runs:
        if trial.fall_reason:
            yield f"{name}: {fall_text(trial)}"


def _engines(result: RaceResult) -> Iterator[RenderableType]:
    """The sprint and the raw trials in both engines, where there are two."""
    from sprintlab.evaluation.report_text import engine_fault, engine_table

    both = engine_table(result)
    if both is None:
        return
    names = tuple(both["names"])
    yield ""
    yield plain_table("Two engines", "quantity", *names, "unit", numbers=names, rows=both["rows"])
    if fault := engine_fault(result):
        yield Text(f"marked: {fault}", style="bold red")


def audit_table(audit: AuditReport) -> Table:
    """The exploit audit, one row an exploit."""
    from sprintlab.evaluation.report_text import audit_limit, audit_measured, audit_verdict

    table = plain_table(
        f"Exploit audit: {audit_verdict(audit)}",
        "what",
        "measured: median of the trials",
        "limit",
        "",
        "where the limit comes from",
        numbers=("measured: median of the trials", "limit"),
    )
    for item in audit.items:
        values = (audit_measured(item), audit_limit(item))
        verdict = styled("[green]pass[/]" if item.passed else "[bold red]FAIL[/]")
        table.add_row(item.name, *values, verdict, item.source)
    return table
