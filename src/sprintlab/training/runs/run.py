"""``sprintlab train``: opens a run, iterates until its end, saves, and exports the policy."""

from __future__ import annotations

import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path

import torch
from rich.console import Console

from sprintlab.core.errors import SprintlabError, UnwrittenError, printable
from sprintlab.core.extras import require_package
from sprintlab.core.files import atomic_write_text
from sprintlab.core.garbage import suspended_garbage_collection
from sprintlab.core.interpreters import command_line
from sprintlab.core.reading import refused_as_damaged
from sprintlab.core.signals import handled_by, terminations
from sprintlab.training.learner.distributed import Workers, join_workers
from sprintlab.training.runs.checkpoint import check_robot, read_checkpoint
from sprintlab.training.runs.options import POLICY_NAME, RUN_FILE, TrainOptions, check_places
from sprintlab.training.runs.progress import Board, Reporter, follow_on_wandb, preparing
from sprintlab.training.runs.runner import Runner, device_description
from sprintlab.training.settings_text import settings_toml

_LONGEST_COMMAND = 2000


def pick_device(options: TrainOptions) -> str:
    """``auto`` is the first GPU, else the CPU. Raises ``SprintlabError`` if PyTorch does not see the GPU."""
    found = "cpu" if options.on_cpu else "cuda:0"
    device, count = found if options.device == "auto" else options.device, torch.cuda.device_count()
    if device.startswith("cuda") and int(device.partition(":")[2] or 0) >= count:
        remedy = "install PyTorch for CUDA, or choose --device cpu"
        raise SprintlabError(f"PyTorch sees {count} GPUs and cannot train on {device}: {remedy}")
    return device


def train(options: TrainOptions) -> Path:
    """Train until the time or the iterations are used up, then export; returns the checkpoint's path.

    Raises:
        SprintlabError: there is a checkpoint and ``resume`` is off, or the disk refuses.
            The last checkpoint stays as it is.
        KeyboardInterrupt: Ctrl-C; the iteration was finished and saved.
        SystemExit: 143 on SIGTERM, 129 on a hangup (a closed terminal); finished and saved likewise.
    """
    if options.wandb is not None:
        require_package("wandb", extra="wandb", use="--wandb")
    check_places(options)
    workers = join_workers()
    if workers.leads:
        for name in ("checkpoint.pt", "log.jsonl", POLICY_NAME):
            for half in options.output.glob(f".{name}.*"):  # left by a process that was killed as it wrote
                half.unlink(missing_ok=True)
    with preparing(quiet=not workers.leads), suspended_garbage_collection():
        runner = open_run(options, workers)
    try:
        with _stopping_cleanly(runner, options.checkpoint):
            _session(runner, options)
    finally:
        runner.learner.release_graphs()
    if workers.leads:
        _export(options.checkpoint)
    return options.checkpoint


def open_run(options: TrainOptions, workers: Workers) -> Runner:
    """The run, new or as its checkpoint has it, ready to iterate."""
    checkpoint = options.checkpoint
    saved = read_checkpoint(checkpoint) if options.resume and checkpoint.exists() else None
    settings = saved["settings"] if saved else options.full_settings()
    device = pick_device(options)
    if workers.several and device.startswith("cuda"):
        device = f"cuda:{workers.local_rank}"
    if device.startswith("cuda"):
        torch.cuda.set_device(torch.device(device).index or 0)  # events are noted on the current GPU
    untrainable = "has settings with which nothing can be trained"
    with refused_as_damaged(checkpoint, untrainable) if saved else nullcontext():
        runner = Runner(
            settings, device, saved["command_line"] if saved else command_line(), options.fused, workers
        )
    if saved:
        check_robot(saved, runner.environment.robot)
        runner.load(saved)
    if (length := options.length(resumed=saved is not None)) is not None:
        runner.begin(length)
    return runner


def _record(options: TrainOptions, runner: Runner) -> None:
    """The run's file: every choice of it; a resumed run keeps the file of its beginning."""
    path = options.output / RUN_FILE
    if options.resume and path.is_file():
        return
    typed = printable(" ".join(runner.command_line.split()), _LONGEST_COMMAND)  # no control character
    head = (
        f"Every choice of a training; to train it again: sprintlab train --settings {RUN_FILE}",
        f"typed: {typed}",
        f"hash of the settings, as in the policy's contract: {runner.settings.digest()}",
    )
    text = "".join(f"# {line}\n" for line in head) + settings_toml(runner.settings)
    atomic_write_text(path, text)


def _export(checkpoint: Path) -> None:
    """The policy beside its checkpoint; what the export refuses does not undo the training."""
    from sprintlab.training.runs.export import export_checkpoint

    console = Console(stderr=True)
    try:
        with console.status("exporting the policy") if console.is_terminal else nullcontext():
            export_checkpoint(checkpoint, checkpoint.with_name(POLICY_NAME))
    except SprintlabError as error:
        raise SprintlabError(f"{checkpoint} is trained and kept, but not exported: {error}") from error


def _session(runner: Runner, options: TrainOptions) -> None:
    """One session: iterations, checkpoints, and an orderly end on a signal."""
    progress, leads = runner.progress, runner.workers.leads
    board = None
    if leads:
        _record(options, runner)
        if progress.iteration:  # rows after the checkpoint will be done once more
            runner.save_log(options.output / "log.jsonl")
    if leads and options.tensorboard:
        if options.wandb is not None:
            follow_on_wandb(options.wandb, options.output, runner.settings.as_dict())
        board = Board(options.output, runner.settings.robot, progress.iteration)
    rolled_back = float(runner.learner.rolled_back)
    reporter = Reporter(_title(runner), runner.share, board, rolled_back, quiet=not leads)
    with stop_requests() as stop, reporter:
        _loop(runner, options, stop, reporter)
        if stop:
            reporter.say(f"stopped at iteration {progress.iteration}, saved; go on with --resume")
        else:
            reporter.say(f"done: iteration {progress.iteration}, {options.checkpoint}")


@contextmanager
def stop_requests() -> Iterator[list[int]]:
    """Ctrl-C, SIGTERM and a hangup (a closed terminal) are only noted inside the block, which reads the list.

    A second Ctrl-C interrupts at once, without saving. Outside the main thread signals stay as they are.

    Raises:
        KeyboardInterrupt: at the end, where it was Ctrl-C; ``SystemExit`` with 128 and the number of another.
    """
    asked = list[int]()

    def note(number: int, _: object) -> None:
        if asked and number == signal.SIGINT:
            raise KeyboardInterrupt
        asked.append(number)

    with handled_by(note, [signal.SIGINT, *terminations()]):
        yield asked
        if asked:
            raise KeyboardInterrupt if asked[-1] == signal.SIGINT else SystemExit(128 + asked[-1])


def _title(runner: Runner) -> str:
    """What is trained, and where."""
    settings, robots = runner.settings, runner.environment.num_envs * runner.workers.count
    device = device_description(runner.device)
    return f"{settings.robot}, method {settings.method}, {robots} robots, {device}"


def _loop(runner: Runner, options: TrainOptions, stop: list[int], reporter: Reporter) -> None:
    """Iterate; every process stops and saves at the same iteration as the others."""

    def show(row: dict[str, float]) -> None:
        reporter.show(row, runner.share, None if runner.last_exam is None else runner.last_exam.path)

    saved, ended = time.monotonic(), runner.share >= 1.0
    while not ended:
        before = runner.progress.seconds
        show(runner.iterate())
        if runner.workers.leads:
            keep_milestone(runner, options, before)
        over = runner.share >= 1.0
        due = time.monotonic() - saved >= options.save_seconds
        over, stopped, due = runner.workers.any_of([over, bool(stop), due])
        ended = over or stopped
        if over and (row := runner.examine_at_end()):
            show(row)
        if (ended or due) and runner.workers.leads:
            runner.save(options.checkpoint)
            runner.save_log(options.output / "log.jsonl")
        if ended or due:
            saved = time.monotonic()
    runner.workers.any_of([False])  # the leader has written before the others go on


def keep_milestone(runner: Runner, options: TrainOptions, before: float) -> None:
    """Keep the policy where the last iteration, begun at ``before`` [s], crossed one of its times."""
    every = options.milestones
    if every is None or runner.progress.seconds // every == before // every:
        return
    seconds = every * (runner.progress.seconds // every)
    runner.save_policy(options.output / "milestones" / f"{seconds:04.0f}.pt")


@contextmanager
def _stopping_cleanly(runner: Runner, checkpoint: Path) -> Iterator[None]:
    """Say what a disk that refuses means for the run."""
    try:
        yield
    except UnwrittenError as error:
        remedy = "there is no checkpoint yet: make room and start again"
        if checkpoint.exists():
            remedy = "the last good checkpoint is untouched: make room and go on with --resume"
        raise SprintlabError(
            f"training stopped at iteration {runner.progress.iteration}: {error}; {remedy}"
        ) from error
