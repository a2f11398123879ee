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
from sprintlab.api.evaluations import protocol_settings
from sprintlab.api.policies import PolicyChoice, RobotChoice, open_policy
from sprintlab.api.replays import write_race_replay
from sprintlab.api.results import VERDICTS, Drawn, Progress, in_notebook, kept, silent, table
from sprintlab.core.arguments import checked
from sprintlab.core.checks import check_choice, check_range
from sprintlab.core.files import check_writable, default_folder, reserved_directory
from sprintlab.core.interpreters import command_line
from sprintlab.evaluation import race as races
from sprintlab.evaluation import report_text as texts
from sprintlab.evaluation.results import AuditReport, RaceResult
from sprintlab.plant import on_engine
from sprintlab.robots import RobotDescription

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FIGURES = ("sprint", "speed", "torque_speed", "gait", "base_rates", "power")
"""What ``Race.plot`` draws."""
HIGHEST_SPEED = 40.0
"""Highest speed that a robot is asked for [m/s]."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Race(Drawn):
    """What a race found; prints as a table, draws itself, writes its report."""

    policy: Path
    robot: RobotDescription
    table: str
    """Name, folder or parameter table of the robot."""

    def plot(self, figure: str = "speed") -> Figure:
        """One figure of the report, of those in ``FIGURES``. Raises ``InvalidValueError``."""
        from sprintlab.evaluation.report import planned_figures

        check_choice("figure", figure, FIGURES)
        draw = {name: draw for name, _, _, draw in planned_figures(self.found, self.robot)}
        return in_notebook(draw[figure]())

    def report(self, folder: Path | str | None = None, *, video: bool = False) -> Path:
        """Write the report's folder: ``report.html``, ``replay.html``, ``result.json``, pictures, arrays.

        Args:
            folder: must not exist; ``runs/race-<date>-<time>`` when left out.
            video: also render an MP4 where that is possible.

        Returns:
            The page, ``report.html``.
        """
        with reserved_directory(Path(folder) if folder else default_folder()) as target:
            self._write(target, video, silent)
        return target / "report.html"

    def _write(self, target: Path, video: bool, progress: Progress) -> Race:
        """Write report and replay into a folder; the race, which then names them."""
        from sprintlab.evaluation.race_files import race_facts, write_race

        def told(what: str) -> None:
            progress(what, None)

        facts = race_facts(self.policy, self.found, command_line())
        message = write_race(target, self.found, self.robot, self.table, facts, video, told)
        told("writing the replay")
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

    Raw is the command of the profile as it is; self-paced, it is kept near the speed of the robot.
    Example: sprintlab race sprint --top-speed 13

    Args:
        top_speed: top speed of the profile [m/s]; when left out, a search finds the one at which the robot
            holds the highest speed.
        engine: mujoco, drake (needs the extra drake), or both: sprint and raw trials once more in Drake.
        trials: trials with the raw command and as many with the self-paced one.
        output: folder for the report, which must not exist; runs/race-<date>-<time> when left out.
        report: write a report; --no-report only prints.
        video: render an MP4 for the report; --no-video renders none.
    """
    if top_speed is not None:
        check_range("top_speed", top_speed, 0.1, HIGHEST_SPEED, "m/s")
    if workers is not None:
        check_range("workers", workers, 1, 1024)
    check_range("seed", seed, 0, 2**32 - 1)
    folder = Path(output) if output else default_folder() if report else None
    if folder is not None:
        check_writable(folder)
    path, _, described = open_policy(policy, robot)
    both = engine == "both"
    settings = protocol_settings(trials, seed, plant=on_engine(drive.plant(), "mujoco" if both else engine))
    with nullcontext() if folder is None else reserved_directory(folder) as target:
        progress("running trials", None)
        result = races.evaluate_race(
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
            table=str(robot.absolute() if isinstance(robot, Path) else robot or described.name),
        )
        with kept(found):
            return found if target is None else found._write(target, video, progress)


def _shown(result: RaceResult) -> Iterator[RenderableType]:
    """The audit, what failed of it, every fall, raw beside self-paced, the second engine, remarks."""
    yield audit_table(result.audit)
    for item in result.audit.failed:
        yield Text(f"audit failed: {texts.audit_failure(item)}", style="bold red")
    runs = [("sprint, raw", result.sprint.trial), ("sprint, self-paced", result.sprint_self_paced.trial)]
    for group, name in ((result.raw, "raw"), (result.self_paced, "self-paced")):
        runs += [(f"{name}, seed {trial.settings.seed}", trial) for trial in group.trials]
    yield from (f"{name}: {texts.fall_text(trial)}" for name, trial in runs if trial.fall_reason)
    title = f"\n{result.robot}, policy {result.policy}, command up to {result.top_speed:g} m/s"
    columns = ("quantity", "raw", "self-paced", "unit")
    yield table(title, *columns, numbers=columns[1:3], rows=(row[:4] for row in texts.result_rows(result)))
    if (both := texts.engine_table(result)) is not None:
        names = tuple(both["names"])
        yield table("\nTwo engines", "quantity", *names, "unit", numbers=names, rows=both["rows"])
        if fault := texts.engine_fault(result):
            yield Text(f"marked: {fault}", style="bold red")
    yield from result.notes


def audit_table(audit: AuditReport) -> Table:
    """The exploit audit, one row an exploit."""
    columns = ("what", "measured: median of the trials", "limit", "", "where the limit comes from")
    rows = (
        (item.name, texts.audit_measured(item), texts.audit_limit(item), VERDICTS[item.passed], item.source)
        for item in audit.items
    )
    return table(f"Exploit audit: {texts.audit_verdict(audit)}", *columns, numbers=columns[1:3], rows=rows)
