"""Many trainings through a scheduler: submitit, on Slurm or as processes of this machine.

The sweep hands out work and watches folders; what a run has reached lies in the run's own folder. So a lost
worker is replaced by one that goes on from the checkpoint, and a sweep that is started again skips what is
finished.
"""

from __future__ import annotations

import csv
import io
import os
import shutil
import signal
import subprocess
import tempfile
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sprintlab.core.checks import check_range
from sprintlab.core.errors import SprintlabError
from sprintlab.core.files import atomic_write_json, atomic_write_text
from sprintlab.core.signals import handled_by
from sprintlab.training.runs.sweep_plan import RECORD_NAME, RunPlan

if TYPE_CHECKING:
    from submitit import Job

CURVE_ROWS = 500
"""Rows that a curve keeps at most: enough to draw, small enough to commit."""
LEAVE_SECONDS = 60
"""For which a sweep that was interrupted waits for its local workers to save and end."""
_SPARE_MINUTES = 30.0
"""Start-up, checkpoints and export, on top of the training time that a job asks for."""


# --- in the worker ---------------------------------------------------------------------------------------


def work(plans: Sequence[RunPlan]) -> None:
    """Train one of the runs, that of this task, from its checkpoint if it has one; then export it."""
    import submitit

    plan = plans[submitit.JobEnvironment().local_rank] if len(plans) > 1 else plans[0]
    train_run(plan)


def train_run(plan: RunPlan) -> None:
    """Train and export a run; a finished one is left alone.

    Raises:
        SprintlabError: training or the export is refused, or the disk is.
    """
    from sprintlab.training.runs.run import train

    if plan.finished():
        return
    checkpoint = train(plan.options(), restartable=True, typed=plan.command_line())
    _write_record(plan, checkpoint)


def _write_record(plan: RunPlan, checkpoint: Path) -> None:
    """The learning curve and what was done: small files, to be committed; the record makes it finished."""
    from sprintlab.training.runs.checkpoint import read_checkpoint

    state = read_checkpoint(checkpoint)
    progress = state["progress"]
    atomic_write_text(plan.folder / "curve.csv", curve_text(progress.log))
    reached = {
        "reached_iterations": progress.iteration,
        "environment_steps": progress.environment_steps,
        "seconds": round(progress.seconds, 1),
    }
    done = {name: state[name] for name in ("device", "versions", "date", "command_line")}
    atomic_write_json(plan.folder / RECORD_NAME, {**plan.asked(), **reached, **done, "finished": True})


def curve_text(log: Sequence[dict[str, float]]) -> str:
    """The log as CSV, thinned evenly to at most ``CURVE_ROWS`` rows, the last among them.

    It has the columns of the last row: an earlier version, in which a run began, may have logged others.
    """
    step = -(-len(log) // CURVE_ROWS)
    kept = list(log[::-1][:: max(1, step)][::-1])
    text = io.StringIO()
    columns = list(kept[-1]) if kept else ["iteration"]
    writer = csv.DictWriter(text, columns, extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    writer.writerows(kept)
    return text.getvalue()


# --- where work is done ----------------------------------------------------------------------------------


def visible_gpus() -> list[int]:
    """Numbers of this machine's GPUs that may be used; empty where there are none."""
    chosen = os.environ.get("CUDA_VISIBLE_DEVICES")
    if chosen is not None:
        return [int(each) for each in chosen.split(",") if each.strip().isdecimal()]
    if shutil.which("nvidia-smi") is None:
        return []
    listed = subprocess.run(["nvidia-smi", "-L"], capture_output=True, text=True, check=False)
    return list(range(sum(line.startswith("GPU ") for line in listed.stdout.splitlines())))


class LocalCluster:
    """Processes of this machine, spread over its GPUs.

    Args:
        folder: in which each job's files get a folder.
        per_gpu: trainings side by side on a GPU, or on the CPU where there is no GPU.
        gpus: numbers of the GPUs.
        minutes: that a job may take.

    Attributes:
        slots: jobs at a time.
        bundle: trainings in one job.
    """

    bundle = 1

    def __init__(self, folder: Path, per_gpu: int, gpus: Sequence[int], minutes: float) -> None:
        check_range("per_gpu", per_gpu, 1, 64)
        self._folder, self._gpus, self._minutes = folder, list(gpus), minutes
        self.slots: int | None = per_gpu * max(1, len(self._gpus))

    def submit(self, plans: Sequence[RunPlan], slot: int) -> Job[Any]:
        """Start a process on the GPU of this slot."""
        import submitit

        executor = submitit.LocalExecutor(new_job_folder(self._folder))
        gpu = [self._gpus[slot % len(self._gpus)]] if self._gpus else []
        executor.update_parameters(
            timeout_min=self._minutes, gpus_per_node=len(gpu), visible_gpus=gpu, tasks_per_node=1
        )
        # A child inherits that: Ctrl-C is for the sweep, which ends its jobs.
        with handled_by(signal.SIG_IGN, [signal.SIGINT]):
            return executor.submit(work, list(plans))

    def leave(self, jobs: Sequence[Job[Any]]) -> None:
        """Ask them to save and end; again each second, since a worker that is starting does not listen."""
        for second in range(LEAVE_SECONDS):
            running = [job for job in jobs if not job.done()]
            if not running:
                return
            for job in running:
                last = second == LEAVE_SECONDS - 1
                os.kill(int(job.job_id), signal.SIGKILL if last else signal.SIGTERM)
            time.sleep(1.0)


class SlurmCluster:
    """Jobs of one GPU each on Slurm, with several tasks where trainings share a GPU.

    Args:
        folder: in which each job's files get a folder, on a file system that all machines see.
        per_gpu: trainings side by side on a GPU.
        minutes: that a job may take.
        partition: of the cluster; its default when ``None``.

    Attributes:
        slots: ``None``: Slurm has its own queue.
        bundle: trainings in one job.
    """

    slots: int | None = None

    def __init__(self, folder: Path, per_gpu: int, minutes: float, partition: str | None) -> None:
        check_range("per_gpu", per_gpu, 1, 64)
        if shutil.which("sbatch") is None:
            raise SprintlabError("there is no Slurm here (no sbatch); leave --cluster out to train locally")
        self._folder, self.bundle = folder, per_gpu
        self._minutes, self._partition = minutes, partition

    def submit(self, plans: Sequence[RunPlan], slot: int) -> Job[Any]:
        """Queue one job with a task for each of the runs."""
        import submitit

        executor = submitit.AutoExecutor(new_job_folder(self._folder), cluster="slurm")
        executor.update_parameters(
            name="sprintlab-sweep", timeout_min=int(self._minutes), gpus_per_node=1, tasks_per_node=len(plans)
        )
        if self._partition is not None:
            executor.update_parameters(slurm_partition=self._partition)
        return executor.submit(work, list(plans))

    def leave(self, jobs: Sequence[Job[Any]]) -> None:
        """Let them run: Slurm keeps them, and the next sweep finds what they have done."""


def new_job_folder(jobs: Path) -> Path:
    """A new folder for submitit's files of one job: the numbers of local jobs come again.

    Raises:
        SprintlabError: no folder can be made in ``jobs``.
    """
    try:
        jobs.mkdir(parents=True, exist_ok=True)
        return Path(tempfile.mkdtemp(dir=jobs))
    except OSError as error:
        raise SprintlabError(f"cannot write {jobs}: {error.strerror or error}") from error


def job_minutes(minutes: float) -> float:
    """Time limit of a job that trains for ``minutes``."""
    return minutes + _SPARE_MINUTES


# --- the sweep -------------------------------------------------------------------------------------------


@dataclass
class RunStatus:
    """How a run stands.

    Attributes:
        plan: the run.
        state: ``waiting``, ``running``, ``finished``, ``failed``.
        restarts: workers that were lost.
        reason: why it failed.
    """

    plan: RunPlan
    state: str = "waiting"
    restarts: int = 0
    reason: str = ""


@dataclass
class _Active:
    job: Job[Any]
    runs: list[RunStatus]
    slot: int


@dataclass
class Sweep:
    """Hands out runs until all are finished or have failed too often.

    Attributes:
        plans: the runs.
        cluster: where they are trained.
        retries: how often a run is started again.
    """

    plans: Sequence[RunPlan]
    cluster: LocalCluster | SlurmCluster
    retries: int = 3
    runs: list[RunStatus] = field(init=False)

    def __post_init__(self) -> None:
        check_range("retries", self.retries, 0, 1000)
        for plan in self.plans:
            plan.begin()
        self.runs = [
            RunStatus(plan=plan, state="finished" if plan.finished() else "waiting") for plan in self.plans
        ]
        self._queue = deque(run for run in self.runs if run.state == "waiting")
        self._active: list[_Active] = []

    def run(self, watch: Callable[[Sequence[RunStatus]], None], pause: float = 1.0) -> None:
        """Train everything.

        Args:
            watch: called with all runs after every look at them.
            pause: time between looks [s].

        Raises:
            SprintlabError: runs failed; the message names them and why.
        """
        try:
            while self._queue or self._active:
                self._collect()
                self._hand_out()
                watch(self.runs)
                if self._active:
                    time.sleep(pause)
        finally:
            self._leave()
        failed = [run for run in self.runs if run.state == "failed"]
        if failed:
            reasons = "; ".join(f"{run.plan.name}: {run.reason}" for run in failed)
            raise SprintlabError(f"{len(failed)} of {len(self.runs)} runs failed: {reasons}")

    def _leave(self) -> None:
        """The sweep ends with jobs still running: it was interrupted."""
        self.cluster.leave([active.job for active in self._active])
        for run in (run for active in self._active for run in active.runs):
            run.state = "finished" if run.plan.finished() else "waiting"

    def _hand_out(self) -> None:
        taken = {active.slot for active in self._active}
        slots = self.cluster.slots
        while self._queue and (slots is None or len(taken) < slots):
            count = min(self.cluster.bundle, len(self._queue))
            runs = [self._queue.popleft() for _ in range(count)]
            slot = next(number for number in range(len(taken) + 1) if number not in taken)
            taken.add(slot)
            for run in runs:
                run.state = "running"
            self._active.append(_Active(self.cluster.submit([run.plan for run in runs], slot), runs, slot))

    def _collect(self) -> None:
        """Put away what has ended; a run that is not finished has lost its worker."""
        for active in [each for each in self._active if each.job.done()]:
            self._active.remove(active)
            for run in active.runs:
                self._judge(run, active.job)

    def _judge(self, run: RunStatus, job: Job[Any]) -> None:
        if run.plan.finished():
            run.state = "finished"
        elif run.restarts < self.retries:
            run.state, run.restarts = "waiting", run.restarts + 1
            self._queue.append(run)
        else:
            run.state, run.reason = "failed", last_line(job)


def last_line(job: Job[Any]) -> str:
    """The last thing that a job has said, e.g. its error."""
    lines = [line for line in (job.stderr() or "").splitlines() if line.strip()]
    return lines[-1].strip() if lines else "its worker vanished without a word"


def summary(runs: Sequence[RunStatus]) -> list[dict[str, Any]]:
    """The runs as plain values."""
    return [
        {
            "name": run.plan.name,
            "method": run.plan.method,
            "seed": run.plan.seed,
            "folder": str(run.plan.folder),
            "state": run.state,
            "restarts": run.restarts,
            "reason": run.reason,
            "share": 1.0 if run.state == "finished" else run.plan.share(),
            "last": run.plan.last_row(),
        }
        for run in runs
    ]
