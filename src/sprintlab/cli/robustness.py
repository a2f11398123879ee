"""``sprintlab robustness``: many sprints with everything randomized at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tyro

from sprintlab.api.policies import policy_path, robot_for
from sprintlab.cli.output import plain_table, print_json, progress_bar, stdout_console

if TYPE_CHECKING:
    from collections.abc import Callable

    from sprintlab.evaluation.pool import TrialPool


@dataclass(frozen=True, kw_only=True)
class Robustness:
    """Run many sprints with everything randomized at once: how many stay upright, what they hold.

    Friction, payload, centre of mass, strength, bus voltage, delay, sensor noise, joint offsets, pushes and
    foot pads are drawn anew for every sprint; a few more sprints randomize one of them at a time and tell
    what each costs. Every sprint is kept in a file of its own: run the same command again after a kill, or
    with more trials, and it goes on where it was.

    Attributes:
        policy: a policy file, or the name of a policy that comes with the package.
        trials: sprints with everything randomized at once.
        cause_trials: sprints of each cause alone, and of the nominal robot.
        robot: a robot's name, or a parameter table of one's own (.toml); the policy's when left out.
        top_speed: speed asked for [m/s]; when left out, a search finds that at which most is held.
        distance: of a sprint [m].
        seed: of the first sprint; the next one has the next seed.
        workers: processes; one a core when left out.
        out: folder of the sprints; runs/robustness-<policy> when left out.
        figure: picture to draw (.png, .pdf or .svg); none when left out.
        json: print JSON only.
    """

    policy: tyro.conf.Positional[str] = "sprint"
    trials: int = 1000
    cause_trials: int = 20
    robot: str | None = None
    top_speed: float | None = None
    distance: float = 100.0
    seed: int = 0
    workers: int | None = None
    out: Path | None = None
    figure: Path | None = None
    json: tyro.conf.FlagCreatePairsOff[bool] = False

    def run(self) -> int:
        """Run what is missing and print the numbers.

        Raises:
            SprintlabError: policy, robot, folder or a setting is refused, or the simulation failed.
        """
        from sprintlab.core.files import check_figure_path

        check_figure_path(self.figure)
        policy = policy_path(self.policy)
        folder = self.out or Path("runs") / f"robustness-{policy.stem}"
        with progress_bar(quiet=self.json) as report:
            report("loading", None)
            pieces, top_speed = self._run_sprints(policy, folder, report)
        numbers = self._numbers(policy, folder, top_speed, pieces)
        if self.json:
            print_json(numbers)
        else:
            _print_numbers(numbers)
        return 0

    def _run_sprints(
        self, policy: Path, folder: Path, report: Callable[[str, float | None], None]
    ) -> tuple[list[dict[str, Any]], float]:
        from sprintlab.evaluation.pool import TrialPool
        from sprintlab.evaluation.robustness import StudySettings, run_study
        from sprintlab.robots import load_robot

        with TrialPool(policy, load_robot(robot_for(policy, self.robot)), self.workers) as pool:
            settings = StudySettings(
                top_speed=self.top_speed or _known_speed(folder) or _search(pool, report),
                trials=self.trials,
                cause_trials=self.cause_trials,
                distance=self.distance,
                seed=self.seed,
            )

            def show(done: int, total: int) -> None:
                report(f"sprint {done} of {total}", done / total)

            return run_study(pool, policy, settings, folder, show), settings.top_speed

    def _numbers(
        self, policy: Path, folder: Path, top_speed: float, pieces: Sequence[dict[str, Any]]
    ) -> dict[str, Any]:
        from sprintlab.evaluation.robustness import summarize

        summary = summarize(pieces)
        if self.figure is not None:
            from sprintlab.core.theme import save_figure
            from sprintlab.evaluation.robustness.figure import robustness_figure

            title = f"{policy.stem}, {self.distance:g} m at a command of {top_speed:g} m/s"
            save_figure(self.figure, robustness_figure(summary, pieces, title))
        return {
            "policy": policy.stem,
            "top_speed_command_m_s": top_speed,
            "distance_m": self.distance,
            "seed": self.seed,
            **summary,
            "folder": str(folder),
            "figure": None if self.figure is None else str(self.figure),
        }


def _known_speed(folder: Path) -> float | None:
    """The command of a study that is to go on; ``None`` for a new study."""
    from sprintlab.evaluation.robustness.study import known_top_speed

    return known_top_speed(folder)


def _search(pool: TrialPool, report: Callable[[str, float | None], None]) -> float:
    from sprintlab.evaluation.race import find_top_speed

    report("searching the top speed", None)
    return find_top_speed(pool)


def _print_numbers(numbers: dict[str, Any]) -> None:
    console = stdout_console()
    title = f"{numbers['policy']}, {numbers['distance_m']:g} m at {numbers['top_speed_command_m_s']:g} m/s"
    table = plain_table(
        f"{title}, everything randomized at once", "quantity", "value", "unit", numbers=("value",)
    )
    lower, upper = (f"{100 * bound:.1f}" for bound in numbers["interval_95"])
    table.add_row("upright", f"{numbers['upright']} of {numbers['trials']}", "")
    table.add_row(
        "share upright, 95 % interval", f"{100 * numbers['share_upright']:.1f} ({lower} to {upper})", "%"
    )
    table.add_row("reached the line", f"{numbers['finished']} of {numbers['trials']}", "")
    table.add_row("left its lane", f"{numbers['left_lane']} of {numbers['trials']}", "")
    for reason, count in numbers["falls"].items():
        table.add_row(f"falls: {reason}", str(count), "")
    for quantile, speed in numbers["held_speed_quantiles_m_s"].items():
        table.add_row(f"held speed, {100 * float(quantile):g} % hold less", _cell(speed), "m/s")
    table.add_row("held speed of the nominal robot", _cell(numbers["nominal"]["held_speed_m_s"]), "m/s")
    console.print(table)
    if numbers["causes"]:
        console.print()
        console.print(_cause_table(numbers["causes"]))
    console.print(f"\nsprints: {numbers['folder']}", soft_wrap=True)
    if numbers["figure"]:
        console.print(f"figure: {numbers['figure']}", soft_wrap=True)


def _cause_table(causes: Sequence[dict[str, Any]]) -> Any:
    columns = ("upright", "change of held speed [m/s]", "worst sprint [m/s]")
    table = plain_table("One cause at a time, the most expensive first", "cause", *columns, numbers=columns)
    for row in causes:
        upright = f"{row['upright']} of {row['trials']}"
        table.add_row(
            row["cause"], upright, _cell(row["change_m_s"], "+"), _cell(row["worst_change_m_s"], "+")
        )
    return table


def _cell(value: float | None, sign: str = "") -> str:
    return "-" if value is None else f"{value:{sign}.2f}"
