"""``sprintlab train``: options, progress line, time limit, resume."""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path

import torch

from sprintlab.core.checks import check_choice, check_positive, check_range
from sprintlab.core.errors import SprintlabError
from sprintlab.training.distributed import join_workers
from sprintlab.training.methods import METHODS, method_settings
from sprintlab.training.runner import Runner, command_line, read_checkpoint
from sprintlab.training.settings import TrainingSettings


@dataclass(frozen=True, kw_only=True)
class TrainOptions:
    """How to train.

    Attributes:
        method: one of the paper's six.
        output: folder of the run: ``checkpoint.pt``, ``log.jsonl``.
        minutes: stop after this much time in this sitting.
        iterations: stop at this iteration of the run.
        environments: robots side by side.
        seed: of every random generator.
        device: ``cuda:0``, ``cpu`` or ``auto``.
        resume: go on from the checkpoint in ``output``.
        start_from: another run's checkpoint whose networks and curriculum this run begins with.
        save_seconds: time between checkpoints.
        keep_schedule: take the command schedule from ``settings`` instead of the method's default.
        keep_motor_model: take the motor model from ``settings`` instead of the method's, e.g. flux weakening.
        keep_robots: put the state of every robot into the checkpoint (2 kB each): the run can then go on as
            if it had not stopped. Without, robots start from standing when it is taken up.
        fused: graphs and compiled kernels on a GPU; without them the same code runs plainly, and slowly.
        settings: everything else; ``method`` and ``environments`` are put into it.

    Raises:
        InvalidValueError: an unknown method or a number out of range.
    """

    method: str = "sprint"
    output: Path = Path("runs/train")
    minutes: float = 20.0
    iterations: int = 100_000
    environments: int = 8192
    seed: int = 0
    device: str = "auto"
    resume: bool = False
    start_from: Path | None = None
    save_seconds: float = 60.0
    keep_schedule: bool = False
    keep_motor_model: bool = False
    keep_robots: bool = True
    fused: bool = True
    settings: TrainingSettings = TrainingSettings()

    def __post_init__(self) -> None:
        check_choice("method", self.method, tuple(METHODS))
        check_positive("minutes", self.minutes, "min")
        check_range("iterations", self.iterations, 1, 10**9)
        check_range("environments", self.environments, 2, 10**6)

    def full_settings(self) -> TrainingSettings:
        """The settings with method, environments and seed in place."""
        simulation = replace(self.settings.simulation, environments=self.environments)
        base = replace(self.settings, simulation=simulation, seed=self.seed)
        settings = method_settings(self.method, base)
        if self.keep_motor_model:
            settings = replace(settings, actuator_model=base.actuator_model)
        return replace(settings, schedule=base.schedule) if self.keep_schedule else settings


def pick_device(wanted: str) -> str:
    """``auto`` is the first GPU, else the CPU. Raises ``SprintlabError`` for a GPU that is not there."""
    if wanted == "auto":
        return "cuda:0" if torch.cuda.is_available() else "cpu"
    if wanted.startswith("cuda") and not torch.cuda.is_available():
        raise SprintlabError(f"device {wanted} asked for, but PyTorch sees no GPU")
    return wanted


def train(options: TrainOptions) -> Path:
    """Train until the time or the iterations are used up; returns the checkpoint's path."""
    checkpoint = options.output / "checkpoint.pt"
    saved = read_checkpoint(checkpoint) if options.resume else None
    if saved is None and checkpoint.exists():
        raise SprintlabError(f"{checkpoint} exists: choose another output, or resume it")
    settings = saved["settings"] if saved else options.full_settings()
    typed = saved["command_line"] if saved else command_line()
    workers = join_workers()
    device = pick_device(options.device)
    if workers.several and device.startswith("cuda"):
        device = f"cuda:{workers.local_rank}"
    runner = Runner(settings, device, typed, options.fused, workers)
    if saved:
        runner.load(saved)
    elif options.start_from is not None:
        runner.load(read_checkpoint(options.start_from))
    try:
        _loop(runner, options, checkpoint)
    finally:
        if runner.progress.iteration:
            _save(runner, options, checkpoint)
    return checkpoint


def _loop(runner: Runner, options: TrainOptions, checkpoint: Path) -> None:
    deadline = time.monotonic() + 60.0 * options.minutes
    saved = printed = time.monotonic()
    while runner.progress.iteration < options.iterations and time.monotonic() < deadline:
        row = runner.iterate()
        now = time.monotonic()
        if now - saved > options.save_seconds:
            _save(runner, options, checkpoint)
            saved = now
        if runner.workers.leads and (now - printed > 10.0 or row["iteration"] <= 2):
            print(progress_line(row), file=sys.stderr, flush=True)
            printed = now


def _save(runner: Runner, options: TrainOptions, checkpoint: Path) -> None:
    """Checkpoint and log, by the leading process."""
    if runner.workers.leads:
        runner.save(checkpoint, options.keep_robots)
        runner.save_log(options.output / "log.jsonl")


def progress_line(row: dict[str, float]) -> str:
    """One iteration in one line."""
    return (
        f"it {row['iteration']:.0f}  {row['seconds']:.0f} s  {row['steps_per_second'] / 1e3:.0f}k/s  "
        f"range {row['range_upper']:.1f}  stage {row['stage']:.2f}  v {row['speed']:.2f}  "
        f"p95 {row['speed_p95']:.2f}  p99.9 {row['speed_p999']:.2f}  error {row['command_error']:.2f}  "
        f"reward {row['reward']:.3f}  falls/1k {1e3 * row['falls']:.2f}  contact {row['contact']:.2f}  "
        f"limit {row['on_limit']:.2f}  power {row['power']:.0f}  std {row['action_std']:.2f}  "
        f"lr {row['learning_rate']:.0e}"
    )
