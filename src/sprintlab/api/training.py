"""``method``, ``train``, ``sweep`` and ``export``: from settings to a policy file."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sprintlab.api.reached import LOG_LIMIT, what_was_reached
from sprintlab.api.results import Progress, Result, exit_if_worker, quantities, records, remark, silent
from sprintlab.core.arguments import check_kind, checked
from sprintlab.core.checks import check_range
from sprintlab.core.errors import InvalidValueError
from sprintlab.core.extras import require_package
from sprintlab.core.files import check_writable_file
from sprintlab.core.garbage import suspended_garbage_collection
from sprintlab.core.reading import read_rows
from sprintlab.training import methods as known
from sprintlab.training.runs import sweep as sweeps
from sprintlab.training.runs.checkpoint import read_checkpoint
from sprintlab.training.runs.options import TrainOptions, check_places
from sprintlab.training.settings import TrainingSettings
from sprintlab.training.settings_text import read_settings, settings_toml, to_plain, with_changes

_SHOWN = {
    "iterations": "iterations", "seconds": "training_time_s", "speed_median": "speed, median_m_s",
    "speed_p95": "speed, fastest 5 %_m_s", "range_upper": "commands_up_to_m_s",
    "reward": "reward_per_second", "falls": "falls_per_robot_and_step",
}  # fmt: skip
"""What is shown of a run's last iteration, by its names in the log."""


def require_training() -> None:
    """Refuse with one sentence where the training extra is not installed. Raises ``SprintlabError``."""
    require_package("torch", extra="train", use="training")


@checked
def method(
    name: str = "acs",
    changes: Mapping[str, Any] | None = None,
    *,
    robot: str | Path = "bp2",
    environments: int | None = None,
    seed: int = 0,
) -> TrainingSettings:
    """The settings of a training method, changed where wanted; every choice of a run is a field of them.

    Args:
        name: acs, baseline, no-envelope, simplified-dc, fixed-acceleration or uniform-commands.
        changes: dotted names of settings to values: ``{"ppo.steps": 16, "reward.progress.weight": 1.0}``.
        robot: name, folder or table; lengths, speeds and masses are scaled to it.
        environments: robots side by side.
        seed: seed of every random generator.
    """
    settings = known.method(name, robot=_robot_word(robot), seed=seed)
    sized = {} if environments is None else {"simulation.environments": environments}
    return with_changes(settings, {**sized, **(changes or {})})


def _robot_word(robot: str | Path) -> str:
    """A robot's name, folder or table as text that means the same in every folder."""
    return str(robot.absolute()) if isinstance(robot, Path) else robot


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Training(Result):
    """A training run; prints how far it has come, names its policy."""

    folder: Path  # folder of the run: checkpoint, log, settings, policy

    @property
    def checkpoint(self) -> Path:
        """The newest checkpoint."""
        return self.folder / "checkpoint.pt"

    @property
    def policy(self) -> Path:
        """The policy file that the training wrote at its end."""
        return self.folder / "policy.onnx"

    def log(self) -> list[dict[str, float]]:
        """One row per iteration: speeds [m/s], reward, falls, seconds. Raises ``SprintlabError``."""
        return read_rows(self.folder / "log.jsonl", LOG_LIMIT)


@checked
def train(
    robot: str | Path | Any | None = None,
    *,
    method: str | None = None,
    preset: str = "sprintlab",
    seed: int | None = None,
    minutes: float | None = None,
    iterations: int | None = None,
    environments: int | None = None,
    set: Sequence[str] = (),
    settings: Path | str | None = None,
    device: str = "auto",
    output: Path | str = Path("runs/train"),
    resume: bool = False,
    dry_run: bool = False,
    save_seconds: float = 60.0,
    milestones: float | None = None,
    fused: bool = True,
    plain: bool = False,
    wandb: str | None = None,
) -> Training:
    """Train a policy for a robot until the time or the iterations are used up, and export it.

    Example: sprintlab train bp2 --seed 1 --output runs/sprint-1

    Args:
        robot: name, folder or table of the robot (from Python also settings of a run); that of the settings,
            or bp2, when left out.
        method: acs (when left out), baseline, no-envelope, simplified-dc, fixed-acceleration,
            uniform-commands, literal-acs, no-saturation, flux-weakening; after other papers: rlvrl, lp-acrl,
            hound, spot-battery.
        seed: seed of every random generator; that of the settings, or 0, when left out.
        minutes: training time over all sessions [min]; with neither this nor iterations, 60 on a CPU.
        iterations: stop at this iteration of the run, at most 30,000; with neither, 3600 on a GPU.
        environments: robots side by side; 8192 on a GPU and 2048 on a CPU when left out.
        set: a setting that differs from the default, e.g. ppo.steps=16; --dry-run lists all.
        settings: TOML file of the settings that differ, such as the run.toml of another run.
        output: folder of the run: checkpoint, log, run.toml and, at its end, policy.onnx.
        resume: go on from the checkpoint in the folder, where there is one.
        dry_run: print every setting as a file for --settings; train nothing.
        milestones: keep the policy at every multiple of this training time [s], as milestones/0030.pt.
        fused: graphs and compiled kernels on a GPU (--no-fused: the same code without them, slowly).
        plain: write no curves for TensorBoard.
        wandb: project on Weights & Biases that gets the same curves (needs the extra wandb).
    """
    exit_if_worker()
    # Read when PyTorch is imported: threads that spin while they wait make a busy machine five times slower.
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")
    if not dry_run:
        require_training()
    chosen, folder = _chosen_settings(robot, method, preset, settings, set, seed), Path(output)
    options = TrainOptions(
        settings=chosen,
        output=folder,
        minutes=minutes,
        iterations=iterations,
        environments=environments,
        device=device,
        resume=resume,
        save_seconds=save_seconds,
        milestones=milestones,
        fused=fused,
        tensorboard=not plain,
        wandb=wandb,
    )
    if dry_run:
        full = options.full_settings()
        shown = [settings_toml(full).rstrip()]
        return Training(numbers=to_plain(full), shown=shown, folder=folder)
    check_places(options)  # before PyTorch is imported, which takes many seconds
    with suspended_garbage_collection():
        from sprintlab.training.runs.run import train as run

    run(options)
    log = read_rows(folder / "log.jsonl", LOG_LIMIT)
    numbers = {"folder": str(folder), "iterations": len(log), **(log[-1] if log else {})}
    shown: list[Any] = []
    if os.environ.get("RANK", "0") == "0":  # one of several processes prints
        remark("running three trials in the plant to see what the policy reached")
        told = {words: numbers[name] for name, words in _SHOWN.items() if name in numbers}
        shown = [quantities(f"Training in {folder}", told), f"policy: {folder / 'policy.onnx'}"]
        trained = read_checkpoint(folder / "checkpoint.pt")["settings"]  # a resumed run keeps its own
        shown += what_was_reached(folder, trained.robot)
    return Training(numbers=numbers, shown=shown, folder=folder)


def _chosen_settings(
    robot: Any,
    method: str | None,
    preset: str,
    file: Path | str | None,
    changes: Sequence[str],
    seed: int | None,
) -> TrainingSettings:
    """The settings of a training; the arguments are those of ``train``. Raises ``InvalidValueError``."""
    named = None
    if isinstance(robot, TrainingSettings):
        chosen = robot
    else:
        check_kind("robot", robot, str | Path | None)
        named = None if robot is None else _robot_word(robot)
        chosen = known.method(method or known.DEFAULT_METHOD, robot=named or "bp2", preset=preset)
    if file is not None:
        chosen = read_settings(Path(file), chosen)
        for name, typed in (("robot", named), ("method", method)):
            if typed not in (None, getattr(chosen, name)):
                raise InvalidValueError(name, typed, f"{file} is for {getattr(chosen, name)}")
    chosen = with_changes(chosen, changes)
    return chosen if seed is None else with_changes(chosen, {"seed": seed})


@checked
def export(checkpoint: Path | str, output: Path | str, *, progress: Progress = silent) -> Result:
    """Write a training checkpoint as one ONNX file that carries its own contract, checked against PyTorch.

    Example: sprintlab export runs/sprint-0/checkpoint.pt sprint.onnx

    Args:
        checkpoint: checkpoint of a training run.
        output: the ONNX file to write.
    """
    require_training()
    checkpoint, output = Path(checkpoint), Path(output)
    read_checkpoint(checkpoint)
    check_writable_file(output)
    progress("exporting", None)
    from sprintlab.training.runs.export import export_checkpoint

    made = export_checkpoint(checkpoint, output)
    compared = f"greatest difference from PyTorch: {made.difference:.1e}"
    numbers = {**made._asdict(), "path": str(made.path)}
    return Result(numbers=numbers, shown=[f"policy: {made.path}", compared], found=made)


@checked
def sweep(
    output: Path | str,
    *,
    robot: str | Path = "bp2",
    methods: Sequence[str] = (),
    preset: str = "sprintlab",
    seeds: int = 3,
    set: Sequence[str] = (),
    vary: Sequence[str] = (),
    minutes: float | None = None,
    iterations: int | None = None,
    environments: int | None = None,
    device: str = "auto",
    parallel: int = 1,
    retries: int = 3,
    dry_run: bool = False,
    progress: Progress = silent,
) -> Result:
    """Train methods x seeds x settings, one run on each GPU at a time; start it again and it goes on.

    Every run gets a folder <output>/<method>/seed-<k>/; with --vary, one such tree per combination.
    Example: sprintlab sweep runs/study --seeds 3

    Args:
        output: folder of the sweep.
        robot: name, folder or table of the robot.
        methods: methods to train; all six of the paper when left out.
        seeds: number of seeds per method, counted from 0.
        vary: a setting and its values, e.g. ppo.learning_rate=0.001,0.0005; several make all combinations.
        minutes: training time of each run [min]; when left out, the same as that of sprintlab train.
        iterations: iteration at which each run ends.
        environments: robots side by side in each run; when left out, as many as in sprintlab train.
        device: auto: all GPUs of this machine, or its CPU; or one of them: cuda:0, cpu.
        parallel: trainings that share a GPU, or the CPU; memory must allow it.
        retries: how often a run that failed or was killed is started again.
        dry_run: print the commands of the runs that are not finished, for a cluster's scheduler.
    """
    check_range("seeds", seeds, 1, 1000)
    check_range("parallel", parallel, 1, 64)
    check_range("retries", retries, 0, 1000)
    runs = sweeps.plan_sweep(
        Path(output), robot=_robot_word(robot), methods=tuple(methods) or tuple(known.METHODS), preset=preset,
        seeds=range(seeds), fixed=set, varied=sweeps.parse_variations(vary), minutes=minutes,
        iterations=iterations, environments=environments, device=None if device == "auto" else device,
    )  # fmt: skip
    told = [{"run": run.name, "folder": str(run.folder)} for run in runs]
    if dry_run:
        numbers = [
            {**each, "done": run.finished, "command": run.command}
            for each, run in zip(told, runs, strict=True)
        ]
        return Result(numbers=numbers, shown=[run.command for run in runs if not run.finished])
    require_training()
    states = {run.name: "finished" if run.finished else "waiting" for run in runs}

    def watch(found: Mapping[str, str]) -> None:
        for name in [name for name in found if found[name] != states[name]]:
            remark(f"{name}: {found[name]}")
            states[name] = found[name]
        done = sum(state == "finished" for state in found.values())
        progress(f"{done} of {len(runs)} runs finished", done / len(runs))

    def result() -> Result:
        numbers = [
            {**each, "state": states[run.name], "last": run.last_row()}
            for each, run in zip(told, runs, strict=True)
        ]
        columns = {"iteration": "iteration", "speed_p95_m_s": "speed_p95", "falls": "falls"}
        rows = [
            {"run": row["run"], "state": row["state"],
             **{name: row["last"].get(key) for name, key in columns.items()}} for row in numbers
        ]  # fmt: skip
        return Result(numbers=numbers, shown=[records("Sweep", rows)])

    try:
        sweeps.train_all(runs, parallel * sweeps.training_devices(device), retries, watch)
    except BaseException as error:
        error.found = result()  # pyright: ignore[reportAttributeAccessIssue]
        raise
    return result()
