"""``sprintlab train``: options, progress line, time limit, resume."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path

import torch

from sprintlab.core.checks import check_choice
from sprintlab.core.errors import SprintlabError, printable
from sprintlab.core.extras import require_package
from sprintlab.core.files import atomic_write_text
from sprintlab.core.garbage import suspended_garbage_collection
from sprintlab.core.reading import refused_as_damaged
from sprintlab.training.learner.distributed import Workers, join_workers
from sprintlab.training.runs.checkpoint import check_robot, read_checkpoint
from sprintlab.training.runs.clip import Clips
from sprintlab.training.runs.guard import StopRequest, exclusive
from sprintlab.training.runs.options import TrainOptions, check_places
from sprintlab.training.runs.progress import EXAM, Board, Reporter, follow_on_wandb, preparing, working
from sprintlab.training.runs.runner import RunLength, Runner, command_line, device_description
from sprintlab.training.settings_text import settings_toml

POLICY_NAME, RUN_FILE = "policy.onnx", "run.toml"
_LONGEST_COMMAND = 2000
_CLIP_SECONDS = 10.0
"""How long a training waits for its last clip [s]."""


def pick_device(wanted: str) -> str:
    """``auto`` is the first GPU, else the CPU.

    Raises:
        SprintlabError: an unknown name, or a GPU that is not there.
    """
    gpus = [f"cuda:{number}" for number in range(torch.cuda.device_count())]
    if wanted == "auto":
        return gpus[0] if gpus else "cpu"
    if wanted.startswith("cuda") and not gpus:
        raise SprintlabError(f"device {wanted} asked for, but PyTorch sees no GPU")
    check_choice("device", wanted, ("auto", "cpu", *(["cuda", *gpus] if gpus else [])))
    return wanted


def train(options: TrainOptions, restartable: bool = False, typed: str | None = None) -> Path:
    """Train until the time or the iterations are used up, then export; returns the checkpoint's path.

    Args:
        options: what to train, where to and for how long.
        restartable: for schedulers, which start a lost training again with the same words: go on from the
            checkpoint where there is one, count ``minutes`` over all sessions, and where another process
            still trains in ``output``, wait until it is gone.
        typed: the command line, for the policy's contract; that of this process when left out.

    Raises:
        SprintlabError: there is a checkpoint and ``resume`` is off, or the other way round; the folder is in
            use; the disk refuses. The last checkpoint stays as it is.
        KeyboardInterrupt: Ctrl-C; the iteration was finished and saved.
        SystemExit: 143 on SIGTERM, 129 on a hangup (a closed terminal); finished and saved likewise.
    """
    if options.wandb is not None:
        require_package("wandb", extra="wandb", use="--wandb")
    check_places(options, restartable)
    workers = join_workers()
    checkpoint = options.output / "checkpoint.pt"
    with exclusive(options.output, restartable) if workers.leads else nullcontext():
        if workers.leads:
            _remove_halves(options.output)
        if restartable:
            options = replace(options, resume=checkpoint.exists())
        with preparing(quiet=not workers.leads), suspended_garbage_collection():
            runner = open_run(options, workers, typed)
        try:
            if workers.leads:
                with _stopping_cleanly(runner, options):
                    _record(options, runner)
            spent, limit = runner.progress.seconds, options.seconds()
            if limit is not None and not restartable:
                limit += spent
            runner.begin(RunLength(iterations=options.iterations, seconds=limit))
            _sit(options, runner, math.inf if limit is None else limit - spent)
        finally:
            runner.learner.release_graphs()
        if workers.leads:
            _export(checkpoint)
    return checkpoint


def _record(options: TrainOptions, runner: Runner) -> None:
    """The run's file: every choice of it; a run that is taken up keeps the file of its beginning."""
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

    policy = checkpoint.with_name(POLICY_NAME)
    try:
        with working("exporting the policy"):
            export_checkpoint(checkpoint, policy)
    except SprintlabError as error:
        raise SprintlabError(f"{checkpoint} is trained and kept, but not exported: {error}") from error


def open_run(options: TrainOptions, workers: Workers, typed: str | None = None) -> Runner:
    """The run, new or as its checkpoint has it, ready to iterate; errors as ``train`` has them."""
    checkpoint = options.output / "checkpoint.pt"
    saved = read_checkpoint(checkpoint) if options.resume else None
    if saved is None and checkpoint.exists():
        raise SprintlabError(f"{checkpoint} exists: choose another output, or resume it")
    settings = saved["settings"] if saved else options.full_settings()
    words = str(saved["command_line"]) if saved else typed or command_line()
    device = pick_device(options.device)
    if workers.several and device.startswith("cuda"):
        device = f"cuda:{workers.local_rank}"
    untrainable = "has settings with which nothing can be trained"
    with refused_as_damaged(checkpoint, untrainable) if saved else nullcontext():
        runner = Runner(settings, device, words, options.fused, workers)
    if saved:
        check_robot(saved, runner.environment.robot)
        runner.load(saved)
    return runner


def _sit(options: TrainOptions, runner: Runner, seconds: float) -> None:
    """One session: iterations, checkpoints, and an orderly end on a signal."""
    progress, leads = runner.progress, runner.workers.leads
    wanted = options.tensorboard and leads
    if wanted and options.wandb is not None:
        follow_on_wandb(options.wandb, options.output, runner.settings.as_dict())
    board = Board(options.output / "tensorboard", progress.iteration) if wanted else None
    reporter = Reporter(
        title=_title(runner),
        iterations=math.inf if options.iterations is None else options.iterations,
        seconds=seconds,
        started_at=progress.iteration,
        board=board,
        rolled_back=float(runner.learner.rolled_back),
        quiet=not leads,
    )
    clips = Clips(options.output, runner.settings.robot) if wanted else None
    if leads and progress.iteration:
        with _stopping_cleanly(runner, options):  # rows after the checkpoint will be done once more
            runner.save_log(options.output / "log.jsonl")
    with StopRequest().listening() as stop, reporter:
        _loop(runner, options, seconds, stop, reporter, clips)
        if clips is not None:
            reporter.film(clips.finished(wait=_CLIP_SECONDS))
            clips.close()
        if stop:
            reporter.say(f"stopped at iteration {progress.iteration}, saved; go on with --resume")
        else:
            reporter.say(f"done: iteration {progress.iteration}, {options.output / 'checkpoint.pt'}")
        stop.leave()
    if options.figures and leads:
        from sprintlab.training.runs.figures import learning_figures

        learning_figures(options.output / "checkpoint.pt", options.output)


def _title(runner: Runner) -> str:
    """What is trained, and where."""
    settings, robots = runner.settings, runner.environment.num_envs * runner.workers.count
    device = device_description(runner.device)
    return f"{settings.robot}, method {settings.method}, {robots} robots, {device}"


def _loop(
    runner: Runner,
    options: TrainOptions,
    seconds: float,
    stop: StopRequest,
    reporter: Reporter,
    clips: Clips | None,
) -> None:
    """Iterate; every process stops and saves at the same iteration as the others."""
    started = saved = time.monotonic()
    last = math.inf if options.iterations is None else options.iterations
    ended = seconds <= 0.0 or runner.progress.iteration >= last
    while not ended:
        before = runner.progress.seconds
        row = runner.iterate()
        _show(row, runner, reporter, clips)
        keep_milestone(runner, options, before)
        now = time.monotonic()
        over = now - started >= seconds or row["iteration"] >= last or runner.hopeless
        due = now - saved >= options.save_seconds
        over, stopped, due = runner.workers.any_of([over, bool(stop), due])
        ended = over or stopped
        if over and (row := runner.examine_at_end()):
            _show(row, runner, reporter, clips)
        if ended or due:
            _save(runner, options)
            saved = time.monotonic()


def _show(row: dict[str, float], runner: Runner, reporter: Reporter, clips: Clips | None) -> None:
    """One iteration on the screen and the board, and a clip of its exam."""
    reporter.show(row)
    if clips is None:
        return
    reporter.film(clips.finished())
    if EXAM in row and runner.last_exam is not None:
        clips.begin(runner.last_exam.path, int(row["iteration"]))


def keep_milestone(runner: Runner, options: TrainOptions, before: float) -> None:
    """Keep the policy where the last iteration, begun at ``before`` [s], crossed one of its times."""
    every = options.milestones
    if every is None or runner.progress.seconds // every == before // every:
        return
    seconds = every * (runner.progress.seconds // every)
    with _stopping_cleanly(runner, options):
        runner.save_policy(options.output / "milestones" / f"{seconds:04.0f}.pt")


def _save(runner: Runner, options: TrainOptions) -> None:
    """Checkpoint and log."""
    with _stopping_cleanly(runner, options):
        runner.save(options.output / "checkpoint.pt", options.keep_robots)
        if runner.workers.leads:
            runner.save_log(options.output / "log.jsonl")


@contextmanager
def _stopping_cleanly(runner: Runner, options: TrainOptions) -> Iterator[None]:
    """Say what a disk that refuses means for the run."""
    try:
        yield
    except SprintlabError as error:
        if (options.output / "checkpoint.pt").exists():
            remedy = "the last good checkpoint is untouched: make room and go on with --resume"
        else:
            remedy = "there is no checkpoint yet: make room and start again"
        raise SprintlabError(
            f"training stopped at iteration {runner.progress.iteration}: {error}; {remedy}"
        ) from error


def _remove_halves(folder: Path) -> None:
    """Delete the files that killed writes have left, named as tempfile names them."""
    for name in ("checkpoint.pt", "log.jsonl", POLICY_NAME):
        for half in folder.glob(f".{name}.*"):
            if re.fullmatch("[a-z0-9_]{8}", half.suffix.removeprefix(".")):
                half.unlink(missing_ok=True)
