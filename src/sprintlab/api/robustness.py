"""``robustness``: many sprints with everything randomized at once."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import RenderableType

from sprintlab.api.policies import PolicyChoice, RobotChoice, policy_path, trial_pool
from sprintlab.api.processes import Progress, leave_to_the_parent
from sprintlab.api.tables import Drawn, in_notebook, plain_table
from sprintlab.core.arguments import checked

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sprintlab.evaluation.pool import TrialPool
    from sprintlab.evaluation.sweep import Run


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Robustness(Drawn):
    """How many of many sprints stayed upright, what they held, and what each cause costs.

    Attributes:
        policy: name of the policy.
        top_speed: that was asked for [m/s].
        distance: of a sprint [m].
        seed: of the first sprint.
        summary: the numbers, as ``sprintlab.evaluation.robustness.summarize`` gives them.
        sprints: how every sprint ended.
        folder: where they lie, each in a file of its own.
    """

    policy: str
    top_speed: float
    distance: float
    seed: int
    summary: dict[str, Any]
    sprints: list[Run]
    folder: Path

    def to_dict(self) -> dict[str, Any]:
        """Plain values, keys with units; what is undefined is None."""
        return {
            "policy": self.policy,
            "top_speed_command_m_s": self.top_speed,
            "distance_m": self.distance,
            "seed": self.seed,
            **self.summary,
            "folder": str(self.folder),
        }

    def tables(self) -> Iterator[RenderableType]:
        """All sprints together, then one cause at a time."""
        found = self.summary
        title = f"{self.policy}, {self.distance:g} m at {self.top_speed:g} m/s, everything randomized at once"
        table = plain_table(title, "quantity", "value", "unit")
        lower, upper = (f"{100 * bound:.1f}" for bound in found["interval_95"])
        share = f"{100 * found['share_upright']:.1f} ({lower} to {upper})"
        table.add_row("upright", f"{found['upright']} of {found['trials']}", "")
        table.add_row("share upright, 95 % interval", share, "%")
        table.add_row("reached the line", f"{found['finished']} of {found['trials']}", "")
        table.add_row("left its lane", f"{found['left_lane']} of {found['trials']}", "")
        for reason, count in found["falls"].items():
            table.add_row(f"falls: {reason}", str(count), "")
        for quantile, speed in found["held_speed_quantiles_m_s"].items():
            table.add_row(f"held speed, {100 * float(quantile):g} % hold less", _cell(speed), "m/s")
        table.add_row("held speed of the nominal robot", _cell(found["nominal"]["held_speed_m_s"]), "m/s")
        yield table
        if found["causes"]:
            yield ""
            yield _cause_table(found["causes"])
        yield f"\nsprints: {self.folder}"

    def plot(self) -> Figure:
        """Held speeds, and what each cause costs."""
        from sprintlab.evaluation.sweep_figures import robustness_figure

        title = f"{self.policy}, {self.distance:g} m at a command of {self.top_speed:g} m/s"
        return in_notebook(robustness_figure(self.summary, self.sprints, title))


@checked
def robustness(
    policy: PolicyChoice = "sprint",
    *,
    robot: RobotChoice = None,
    trials: int = 1000,
    cause_trials: int = 20,
    top_speed: float | None = None,
    distance: float = 100.0,
    seed: int = 0,
    workers: int | None = None,
    folder: Path | str | None = None,
    progress: Progress = lambda what, share: None,
) -> Robustness:
    """Run many sprints with everything randomized at once: how many stay upright, what they hold.

    Friction, payload, centre of mass, strength, bus voltage, delay, sensor noise, joint offsets, pushes and
    foot pads are drawn anew for every sprint; a few more sprints randomize one of them at a time and tell
    what each costs. Every sprint is kept in a file of its own: run the same again after a kill, or with more
    trials, and it goes on where it was.

    Args:
        policy: a policy file, or the name of a policy that comes with the package.
        robot: a robot's name, or a parameter table of one's own (.toml); the policy's when left out.
        trials: sprints with everything randomized at once.
        cause_trials: sprints of each cause alone, and of the nominal robot.
        top_speed: speed asked for [m/s]; when left out, that of the folder, or a search finds that at which
            most is held.
        distance: of a sprint [m].
        seed: of the first sprint; the next one has the next seed.
        workers: processes; one a core when left out.
        folder: folder of the sprints; runs/robustness-<policy> when left out.
        progress: called with what is being done and the share done.

    Raises:
        SprintlabError: policy, robot, folder or a setting is refused, or the simulation failed.
    """
    leave_to_the_parent()
    from sprintlab.evaluation.robustness import StudySettings, run_study, summarize
    from sprintlab.evaluation.sweep import stored_study

    path = policy_path(policy)
    place = Path("runs") / f"robustness-{path.stem}" if folder is None else Path(folder)
    stored = stored_study(place)
    settings = StudySettings(  # refused before the search for a speed
        top_speed=top_speed or 1.0,
        trials=trials,
        cause_trials=cause_trials,
        distance=distance,
        seed=seed,
    )
    with trial_pool(path, robot, workers) as pool:
        speed = top_speed or stored.get("top_speed") or _search(pool, progress)
        settings = replace(settings, top_speed=speed)
        sprints = run_study(
            pool,
            settings,
            place,
            lambda done, total: progress(f"sprint {done} of {total}", done / total),
        )
    return Robustness(
        policy=path.stem,
        top_speed=settings.top_speed,
        distance=distance,
        seed=seed,
        summary=summarize(sprints),
        sprints=sprints,
        folder=place,
    )


def _search(pool: TrialPool, progress: Progress) -> float:
    from sprintlab.evaluation.race import find_top_speed

    progress("searching the top speed", None)
    return find_top_speed(pool)


def _cause_table(causes: list[dict[str, Any]]) -> RenderableType:
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
