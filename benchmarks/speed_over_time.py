"""From nothing to speed: what the policies of a training held, over its seconds.

    sprintlab train sprint --output runs/sprint --milestones 20
    python benchmarks/speed_over_time.py runs/sprint --output results/throughput/speed_over_time.json \\
        --figure docs/figures/speed-over-time.png

Every milestone is exported and runs the evaluation's profile in MuJoCo C, raw: rising v* until more than
one trial in five falls before the end of the hold. Its speed is the highest mean speed over the last 2 s of
a hold. Whether it also brakes and stands is another question, which a second column answers: the highest v*
that trials completed without a fall, stop and stand included. Training seconds are those of the iterations;
starting the process and compiling come before them.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from harness import EVALUATION_PACKAGES, answer, circumstances
from matplotlib.figure import Figure
from rich.console import Console
from rich.progress import track
from rich.table import Table

from sprintlab.core.checks import check_positive, check_range
from sprintlab.core.errors import SprintlabError
from sprintlab.core.files import atomic_write_bytes
from sprintlab.core.theme import LIGHT, axis_legend, png_bytes, style_axis, themed_figure
from sprintlab.evaluation.pool import TrialPool, WorkerProcesses
from sprintlab.evaluation.protocol import ProtocolSettings, search_speeds
from sprintlab.robots import load_robot
from sprintlab.training.runs.checkpoint import read_checkpoint
from sprintlab.training.runs.export import export_checkpoint

GOAL = (180.0, 10.0)
"""Training time [s] and held speed [m/s]."""


def milestone_files(run: Path) -> list[Path]:
    """Milestones of a run by time, and its last checkpoint.

    Raises:
        SprintlabError: the run kept none.
    """
    found = sorted((run / "milestones").glob("*.pt"))
    if not found:
        raise SprintlabError(f"{run} has no milestones: train with --milestones SECONDS")
    return [*found, run / "checkpoint.pt"] if (run / "checkpoint.pt").is_file() else found


@dataclass(frozen=True, kw_only=True)
class Held:
    """A command and what came of its trials.

    Attributes:
        top_speed: commanded [m/s].
        held: mean speed over the last 2 s of the hold, of the trials that reached its end [m/s].
        passed: whether enough of them did.
        completed: whether enough of them also braked and stood.
    """

    top_speed: float
    held: float
    passed: bool
    completed: bool


def hold_speed(pool: TrialPool, top_speed: float, settings: ProtocolSettings) -> Held:
    """Run the trials of one command [m/s]; none is left out because another fell."""
    trials = pool.trials(settings.requests(top_speed, self_paced=False))
    through = [t for t in trials if t.fall_time is None or t.fall_time > t.hold_interval[1]]
    speeds = [trial.metrics.held_speed for trial in through]
    return Held(
        top_speed=top_speed,
        held=sum(speeds) / len(speeds) if speeds else 0.0,
        passed=len(through) >= settings.required,
        completed=sum(trial.completed for trial in trials) >= settings.required,
    )


def measure_milestone(path: Path, processes: WorkerProcesses, settings: ProtocolSettings) -> dict[str, Any]:
    """What one policy of a training holds."""
    state = read_checkpoint(path)
    progress, robot = state["progress"], load_robot(state["settings"].robot)
    with tempfile.TemporaryDirectory() as folder:
        policy = export_checkpoint(path, Path(folder) / "policy.onnx").path
        with TrialPool(policy, robot, processes=processes) as pool:
            tried = search_speeds(settings, partial(hold_speed, pool, settings=settings))
    fastest = max((one for one in tried if one.passed), key=lambda one: one.held, default=None)
    return {
        "seconds": progress.seconds,
        "iterations": progress.iteration,
        "environment_steps": progress.environment_steps,
        "top_speed": fastest.top_speed if fastest else 0.0,
        "held_speed": fastest.held if fastest else 0.0,
        "completed_top_speed": max((one.top_speed for one in tried if one.completed), default=0.0),
    }


def run_facts(run: Path) -> dict[str, Any]:
    """What was trained, where and when, from the last file."""
    state = read_checkpoint(milestone_files(run)[-1])
    settings = state["settings"]
    return {
        "method": settings.method,
        "seed": settings.seed,
        "config_hash": settings.digest(),
        "environments": settings.simulation.environments,
        "timestep": settings.simulation.timestep,
        "substeps": settings.simulation.substeps,
        "precision": settings.ppo.precision,
        "device": state["device"],
        "versions": state["versions"],
        "command_line": state["command_line"],
        "date": state["date"],
    }


def draw(runs: Sequence[dict[str, Any]], goal: tuple[float, float] = GOAL) -> Figure:
    """Held speed over training seconds, one line a run, and the goal."""
    figure, (axis,) = themed_figure(LIGHT, (7.0, 3.8), 1, 1)
    for run in runs:
        rows = run["milestones"]
        label = f"{run['facts']['method']}, seed {run['facts']['seed']}"
        axis.plot(
            [r["seconds"] for r in rows], [r["held_speed"] for r in rows], "o-", markersize=3, label=label
        )
    axis.plot(*goal, marker="*", markersize=12, linestyle="none", color=LIGHT.second, label="goal")
    axis.set(xlabel="training time [s]", ylabel="held speed [m/s]", xlim=(0.0, None), ylim=(0.0, None))
    style_axis(axis, LIGHT)
    axis_legend(axis, LIGHT, loc="lower right")
    return figure


def show(result: dict[str, Any]) -> None:
    """A table a run."""
    for run in result["runs"]:
        facts = run["facts"]
        title = f"{facts['method']}, seed {facts['seed']}, {facts['device']}"
        columns = ("training s", "iterations", "million steps", "v* m/s", "held m/s", "completed to m/s")
        table = Table(*columns, title=title)
        for row in run["milestones"]:
            counts = (f"{row['iterations']}", f"{row['environment_steps'] / 1e6:.0f}")
            speeds = (f"{row['top_speed']:g}", f"{row['held_speed']:.2f}", f"{row['completed_top_speed']:g}")
            table.add_row(f"{row['seconds']:.0f}", *counts, *speeds)
        Console().print(table)


def parse() -> argparse.Namespace:
    """The command line, checked."""
    parser = argparse.ArgumentParser(description="Held speed over the seconds of a training.")
    parser.add_argument("runs", type=Path, nargs="+", help="folders of runs with milestones")
    parser.add_argument("--trials", type=int, default=5)
    parser.add_argument("--grid", type=float, default=0.5, help="step between profile speeds [m/s]")
    parser.add_argument("--top", type=float, default=15.0, help="highest profile speed [m/s]")
    parser.add_argument("--workers", type=int, help="processes; one a core when left out")
    parser.add_argument("--output", type=Path, help="JSON file")
    parser.add_argument("--figure", type=Path, help="PNG file")
    parser.add_argument("--json", action="store_true", help="print JSON only")
    chosen = parser.parse_args()
    check_range("trials", chosen.trials, 2, 1000)
    check_positive("grid", chosen.grid, "m/s")
    return chosen


def measure(chosen: argparse.Namespace) -> dict[str, Any]:
    """Every milestone of every run; the figure is written here, too.

    Raises:
        SprintlabError: a run has no milestones, or something cannot be written.
    """
    settings = ProtocolSettings(
        trials=chosen.trials,
        required=chosen.trials - max(1, chosen.trials // 5),
        grid=chosen.grid,
        first_step=4 * chosen.grid,
        start=2.0,
        top=chosen.top,
    )
    files = [(run, path) for run in chosen.runs for path in milestone_files(run)]
    found: dict[Path, list[dict[str, Any]]] = {run: [] for run in chosen.runs}
    with WorkerProcesses(chosen.workers) as processes:
        for run, path in track(files, "milestones", console=Console(stderr=True), disable=chosen.json):
            found[run].append(measure_milestone(path, processes, settings))
    runs = [{"facts": run_facts(run), "milestones": rows} for run, rows in found.items()]
    if chosen.figure is not None:
        atomic_write_bytes(chosen.figure, png_bytes(draw(runs)))
    return {**circumstances(EVALUATION_PACKAGES), "runs": runs}


if __name__ == "__main__":
    sys.exit(answer(parse, measure, show))
