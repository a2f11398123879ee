"""``sprintlab sweep``: methods x seeds x settings through a scheduler, with a table of how they stand."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from sprintlab.cli.output import plain_table, print_json, stderr_console, stdout_console
from sprintlab.core.extras import require_package

if TYPE_CHECKING:
    from rich.table import Table

    from sprintlab.training.runs.sweep import Cluster, RunStatus
    from sprintlab.training.runs.sweep_plan import RunPlan


@dataclass(frozen=True, kw_only=True)
class Sweep:
    """Train methods x seeds x settings, several at a time; start it again and it goes on.

    Every run gets <out>/<method>/seed-<k>/ with checkpoint.pt, log.jsonl, curve.csv, run.json, policy.onnx.
    With --vary there is a folder of that kind for each combination.

    Attributes:
        out: folder of the sweep.
        methods: to train; all six of the paper when left out.
        preset: sprintlab, or paper: the paper's reward table to the letter.
        seeds: number of seeds a method, from 0.
        set: a setting of every run that differs from the default, e.g. ppo.steps=16.
        vary: a setting and its values, e.g. ppo.learning_rate=0.001,0.0005; several make all combinations.
        minutes: training time of each run, over all sessions.
        iterations: at which each run ends, if the time has not ended it.
        environments: robots side by side in each run.
        device: of each run: auto, cuda:0 or cpu; every worker sees only the GPU that it was given.
        per_gpu: trainings that share a GPU, or the CPU where there is none; memory must allow it.
        gpus: GPUs of this machine to use; all when left out.
        cluster: local: processes of this machine; slurm: jobs with one GPU each.
        partition: of the Slurm cluster.
        save_seconds: time between checkpoints: what a lost worker costs at most.
        retries: how often a run whose worker was lost, or which failed, is started again.
        dry_run: only say what would be trained.
        json: print JSON only.
    """

    out: tyro.conf.Positional[Path]
    methods: tuple[str, ...] = ()
    preset: str = "sprintlab"
    seeds: int = 3
    set: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    vary: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    minutes: float = 7.0
    iterations: int = 30_000
    environments: int = 32768
    device: str = "auto"
    per_gpu: int = 1
    gpus: int | None = None
    cluster: str = "local"
    partition: str | None = None
    save_seconds: float = 60.0
    retries: int = 3
    dry_run: bool = False
    json: bool = False

    def run(self) -> int:
        """Train everything that is not finished.

        Raises:
            SprintlabError: an option is refused, a package is missing, or runs failed.
        """
        plans = self._plans()
        if self.dry_run:
            self._print_plans(plans)
            return 0
        require_package("submitit", extra="sweep", use="a sweep")
        from sprintlab.api.training import require_training
        from sprintlab.training.runs.sweep import Sweep as Training
        from sprintlab.training.runs.sweep import summary

        require_training()
        training = Training(plans, self._cluster(), self.retries)
        try:
            with watching(quiet=self.json) as watch:
                training.run(watch)
        finally:
            if self.json:
                print_json(summary(training.runs))
            else:
                stdout_console().print(status_table(training.runs))
        return 0

    def _plans(self) -> list[RunPlan]:
        from sprintlab.core.checks import check_range
        from sprintlab.training.methods import METHODS
        from sprintlab.training.runs.sweep_plan import parse_variations, plan_sweep
        from sprintlab.training.settings_text import parse_assignment

        check_range("seeds", self.seeds, 1, 1000)
        return plan_sweep(
            self.out,
            self.methods or tuple(METHODS),
            range(self.seeds),
            dict(map(parse_assignment, self.set)),
            parse_variations(self.vary),
            minutes=self.minutes,
            iterations=self.iterations,
            environments=self.environments,
            device=self.device,
            save_seconds=self.save_seconds,
            preset=self.preset,
        )

    def _cluster(self) -> Cluster:
        from sprintlab.core.checks import check_choice, check_range
        from sprintlab.training.runs.sweep import LocalCluster, SlurmCluster, job_minutes, visible_gpus

        check_choice("cluster", self.cluster, ("local", "slurm"))
        folder, minutes = self.out / ".jobs", job_minutes(self.minutes)
        if self.cluster == "slurm":
            return SlurmCluster(folder, self.per_gpu, minutes, self.partition)
        found = [] if self.device == "cpu" else visible_gpus()
        if self.gpus is not None:
            check_range("gpus", self.gpus, 1, max(1, len(found)))
        return LocalCluster(folder, self.per_gpu, found[: self.gpus], minutes)

    def _print_plans(self, plans: Sequence[RunPlan]) -> None:
        rows = [
            {"run": plan.name, "folder": str(plan.folder), "done": plan.finished(), "hash": plan.digest()}
            for plan in plans
        ]
        if self.json:
            print_json(rows)
            return
        table = plain_table(f"{len(rows)} runs", "run", "folder", "state", "settings")
        for row in rows:
            table.add_row(row["run"], row["folder"], "finished" if row["done"] else "to do", row["hash"][:10])
        stdout_console().print(table)


def status_table(runs: Sequence[RunStatus]) -> Table:
    """How every run stands; the held speed is that of the fastest 0.1 % of the robots."""
    numbers = ("iteration", "done %", "steps/s", "held m/s", "falls/1k", "minutes to go", "restarts")
    table = plain_table("sweep", "run", "state", *numbers, numbers=numbers)
    for run in runs:
        row, share = run.plan.last_row(), run.plan.share()
        to_go = row["seconds"] * (1.0 / max(share, 1e-9) - 1.0) / 60.0 if row else float("nan")
        cells = ("-", "0", "-", "-", "-", "-")
        if row:
            cells = (
                f"{row['iteration']:.0f}",
                f"{100 * share:.0f}",
                f"{row['steps_per_second']:.0f}",
                f"{row['speed_p999']:.2f}",
                f"{1e3 * row['falls']:.2f}",
                "0" if run.state == "finished" else f"{to_go:.0f}",
            )
        table.add_row(run.plan.name, run.state, *cells, str(run.restarts))
    return table


@contextmanager
def watching(quiet: bool) -> Iterator[Callable[[Sequence[RunStatus]], None]]:
    """Yield a function that shows the runs on stderr: a live table on a terminal, else changes of state."""
    from rich.live import Live

    console, seen = stderr_console(), dict[str, tuple[str, int]]()

    def tell(runs: Sequence[RunStatus]) -> None:
        for run in runs:
            now = (run.state, run.restarts)
            if seen.get(run.plan.name) != now and not quiet:
                console.print(f"{run.plan.name}: {run.state}, {run.restarts} restarts", soft_wrap=True)
            seen[run.plan.name] = now

    if quiet or not console.is_terminal:
        yield tell
        return
    with Live(console=console, transient=True, auto_refresh=False) as live:
        yield lambda runs: live.update(status_table(runs), refresh=True)
