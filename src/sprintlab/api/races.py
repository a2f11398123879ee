"""``race``: 100 m and the protocol at a policy's top speed, as one object."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from sprintlab.api.drive import DriveOptions
from sprintlab.api.policies import PolicyChoice, RobotChoice, policy_and_robot
from sprintlab.api.results import Drawn, Progress, command_line, in_notebook, kept, silent, styled, table
from sprintlab.core.arguments import checked
from sprintlab.core.checks import check_choice, check_range
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
        policy: the policy file.
        robot: that ran.
        table: name, folder or parameter table of the robot.
    """

    policy: Path
    robot: RobotDescription
    table: str

    def plot(self, figure: str = "speed") -> Figure:
        """One figure of the report.

        Args:
            figure: one of ``FIGURES``.

        Raises:
            InvalidValueError: there is no such figure.
        """
        from sprintlab.core.theme import LIGHT
        from sprintlab.evaluation.report import planned_figures

        check_choice("figure", figure, FIGURES)
        draw = {name: draw for name, _, _, draw in planned_figures(self.found, self.robot)}
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
            self._write(target, video, silent)
        return target / "report.html"

    def _write(self, target: Path, video: bool, progress: Progress) -> Race:
        """Write report and replay into a folder; the race, which then names them."""
        from sprintlab.api.replays import write_race_replay
        from sprintlab.evaluation.race_files import race_facts, write_race

        facts = race_facts(self.policy, self.found, command_line())
        message = write_race(
            target,
            self.found,
            self.robot,
            self.table,
            facts,
            video,
            progress=lambda what: progress(what, None),
        )
        progress("writing the replay", None)
        write_race_replay(target, self.robot)
        files = [f"\nreport: {target / 'report.html'}", f"replay: {target / 'replay.html'}"]
        shown = [*self.shown, *files, message or f"video: {target / 'sprint.mp4'}"]
        return replace(self, numbers={**self.numbers, "facts": facts, "folder": str(target)}, shown=shown)


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
    output: Path | str | None = None,
    report: bool = False,
    video: bool = False,
    drive: DriveOptions = DriveOptions(),
    workers: int | None = None,
    progress: Progress = silent,
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
        output: folder for the report, which must not exist; runs/race-<date>-<time> when left out.
        report: whether a report is written; always with output.
        video: whether the report has an MP4, too.
        drive: motor model, battery and heat; the published numbers' when left out.
        workers: processes; one a core when left out.
        progress: called with what is being done.

    Raises:
        SprintlabError: the policy, the robot, the folder or a setting is refused, or the simulation failed.
        UnwrittenError: the disk has no room for the report any more; its ``found`` is the race.
    """
    if top_speed is not None:
        check_range("top_speed", top_speed, 0.1, HIGHEST_SPEED, "m/s")
    if workers is not None:
        check_range("workers", workers, 1, 1024)
    check_range("seed", seed, 0, 2**32 - 1)
    folder = Path(output) if output else default_folder() if report else None
    if folder is not None:
        check_writable(folder)
    path, name = policy_and_robot(policy, robot)
    from sprintlab.api.evaluations import protocol_settings
    from sprintlab.evaluation.race import evaluate_race
    from sprintlab.plant import on_engine
    from sprintlab.robots import load_robot

    both = engine == "both"
    settings = protocol_settings(trials, seed, plant=on_engine(drive.plant(), "mujoco" if both else engine))
    described = load_robot(name)
    with nullcontext() if folder is None else reserved_directory(folder) as target:
        progress("running trials", None)
        result = evaluate_race(
            path,
            described,
            top_speed=top_speed,
            distance=distance,
            settings=settings,
            second_engine="drake" if both else None,
            workers=workers,
            progress=progress,
        )
        found = Race(
            numbers=result.to_dict(),
            shown=list(_shown(result)),
            found=result,
            draw=lambda: found.plot(),
            policy=path,
            robot=described,
            table=str(name.absolute() if isinstance(name, Path) else name),
        )
        with kept(found):
            return found if target is None else found._write(target, video, progress)


def _shown(result: RaceResult) -> Iterator[RenderableType]:
    """The audit, what failed of it, every fall, raw beside self-paced, the second engine, remarks."""
    from sprintlab.evaluation.report_text import audit_failure, engine_fault, engine_table, fall_text

    yield audit_table(result.audit)
    for item in result.audit.failed:
        yield Text(f"audit failed: {audit_failure(item)}", style="bold red")
    runs = [("sprint, raw", result.sprint.trial), ("sprint, self-paced", result.sprint_self_paced.trial)]
    for group, name in ((result.raw, "raw"), (result.self_paced, "self-paced")):
        runs += [(f"{name}, seed {trial.settings.seed}", trial) for trial in group.trials]
    yield from (f"{name}: {fall_text(trial)}" for name, trial in runs if trial.fall_reason)
    yield ""
    yield result_table(result)
    if (both := engine_table(result)) is not None:
        names = tuple(both["names"])
        yield ""
        yield table("Two engines", "quantity", *names, "unit", numbers=names, rows=both["rows"])
        if fault := engine_fault(result):
            yield Text(f"marked: {fault}", style="bold red")
    yield from result.notes


def audit_table(audit: AuditReport) -> Table:
    """The exploit audit, one row an exploit."""
    from sprintlab.evaluation.report_text import audit_limit, audit_measured, audit_verdict

    columns = ("what", "measured: median of the trials", "limit", "", "where the limit comes from")
    verdicts = {True: styled("[green]pass[/]"), False: styled("[bold red]FAIL[/]")}
    rows = (
        (item.name, audit_measured(item), audit_limit(item), verdicts[item.passed], item.source)
        for item in audit.items
    )
    return table(f"Exploit audit: {audit_verdict(audit)}", *columns, numbers=columns[1:3], rows=rows)


def result_table(result: RaceResult) -> Table:
    """The numbers of a race, raw beside self-paced."""
    from sprintlab.evaluation.report_text import result_rows

    title = f"{result.robot}, policy {result.policy}, command up to {result.top_speed:g} m/s"
    columns = ("quantity", "raw", "self-paced", "unit")
    rows = (row[:4] for row in result_rows(result))
    return table(title, *columns, numbers=columns[1:3], rows=rows)
