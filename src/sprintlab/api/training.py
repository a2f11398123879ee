"""``method``, ``train``, ``sweep``, ``learning`` and ``export``: from settings to a policy file."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sprintlab.api.reached import what_was_reached
from sprintlab.api.results import (
    Drawn,
    Progress,
    Result,
    leave_to_the_parent,
    remark,
    silent,
    table,
)  # fmt: skip
from sprintlab.core.arguments import check_kind, checked
from sprintlab.core.checks import check_range
from sprintlab.core.errors import InvalidValueError, SprintlabError
from sprintlab.core.extras import require_package
from sprintlab.core.files import check_writable, check_writable_file
from sprintlab.core.garbage import suspended_garbage_collection
from sprintlab.core.reading import read_rows, refused_as_damaged

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sprintlab.control.pace import PaceContract
    from sprintlab.training.runs.sweep import SweptRun
    from sprintlab.training.settings import TrainingSettings

_LOG_LIMIT = 64 << 20
NEEDED = ("torch",)
UNITS = {
    "environment_steps": "policy steps",
    "seconds": "s",
    "speed_median": "m/s",
    "speed_p95": "m/s",
    "speed_p999": "m/s",
    "range_upper": "m/s",
    "falls": "per robot and step",
}
"""Units of a run's numbers by name."""


def require_training() -> None:
    """Refuse with one sentence where the training extra is not installed.

    Raises:
        SprintlabError: names a missing package and how to install it.
    """
    for name in NEEDED:
        require_package(name, extra="train", use="training")


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
        changes: dotted names of settings to values, e.g. ``{"ppo.steps": 16, "rewards.progress": 1.0}``.
        robot: name, folder or table; lengths, speeds and masses are scaled to it.
        environments: robots side by side.
        seed: of every random generator.

    Raises:
        SprintlabError: an unknown method or setting, or a value that is not allowed.
    """
    from sprintlab.training import methods
    from sprintlab.training.settings_text import with_changes

    settings = methods.method(name, robot=_robot_word(robot), seed=seed)
    sized = {} if environments is None else {"simulation.environments": environments}
    return with_changes(settings, {**sized, **(changes or {})})


def _robot_word(robot: str | Path) -> str:
    """A robot's name, folder or table as text that means the same in every folder."""
    return str(robot.absolute()) if isinstance(robot, Path) else robot


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Training(Drawn):
    """A training run; prints how far it has come, draws its curves, names its policy.

    Attributes:
        folder: of the run: checkpoint, log, settings, policy.
    """

    folder: Path

    @property
    def checkpoint(self) -> Path:
        """The newest checkpoint."""
        return self.folder / "checkpoint.pt"

    @property
    def policy(self) -> Path:
        """The policy file that the training wrote at its end."""
        return self.folder / "policy.onnx"

    def log(self) -> list[dict[str, float]]:
        """One row per iteration: speeds [m/s], reward, falls, seconds.

        Raises:
            SprintlabError: the run has no log, or a damaged one.
        """
        return read_rows(self.folder / "log.jsonl", _LOG_LIMIT)


def training_in(folder: Path) -> Training:
    """The training run of a folder.

    Raises:
        SprintlabError: the run has no log, or a damaged one.
    """
    log = read_rows(folder / "log.jsonl", _LOG_LIMIT)

    def draw() -> Figure:
        require_training()
        from sprintlab.training.runs.figures import learning_curve

        return learning_curve(log)

    numbers = {"folder": str(folder), "iterations": len(log), **(log[-1] if log else {})}
    names = ("iterations", "seconds", "speed_median", "speed_p999", "range_upper", "reward", "falls")
    rows = ((name.replace("_", " "), f"{numbers[name]:.4g}") for name in names if name in numbers)
    shown = [table(f"Training in {folder}", "what", "value", rows=rows)]
    return Training(numbers=numbers, shown=shown, draw=draw, folder=folder)


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

    Args:
        robot: name, folder or table of the robot, to which lengths, speeds and masses are scaled; that of the
            settings, or bp2, when left out. From Python also settings of a run, as ``sl.method`` gives them.
        method: acs (when left out), baseline, no-envelope, simplified-dc, fixed-acceleration,
            uniform-commands; literal-acs: commands that follow the robot and move toward nothing;
            no-saturation; after other papers: rlvrl, lp-acrl, after-hacl, hound, stride-prior.
        preset: sprintlab, or paper: the paper's reward table to the letter, no copied states, no fast starts.
        seed: of every random generator; that of the settings, or 0, when left out.
        minutes: end the run after this much training time, over all sessions; without minutes and iterations
            after 7 on a GPU, 60 on a CPU.
        iterations: stop at this iteration of the run; at most 30,000.
        environments: robots side by side; 32768 on a GPU and 2048, with small networks, on a CPU when left
            out.
        set: a setting that differs from the default, e.g. ppo.steps=16; --dry-run lists all.
        settings: TOML file of the settings that differ, such as the run.toml of another run.
        device: cuda:0, cpu or auto.
        output: folder of the run: checkpoint, log, run.toml and, at its end, policy.onnx.
        resume: go on from the checkpoint in the folder, where there is one.
        dry_run: print every setting as a file for --settings, and train nothing.
        save_seconds: time between checkpoints.
        milestones: keep the policy as it is at every multiple of this training time [s], as
            output/milestones/0030.pt and so on.
        fused: graphs and compiled kernels on a GPU; without them the same code runs plainly, and slowly.
        plain: no curves in output/tensorboard.
        wandb: project on Weights & Biases that gets the same curves (needs the extra wandb).

    Raises:
        SprintlabError: the extra is not installed, or a setting or the folder is refused.
    """
    leave_to_the_parent()
    # Read when PyTorch is imported: threads that spin while they wait make a busy machine five times slower.
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")
    if not dry_run:
        require_training()
    from sprintlab.training.runs.options import TrainOptions, check_places
    from sprintlab.training.settings_text import settings_toml, to_plain

    chosen = _chosen_settings(robot, method, preset, settings, set, seed)
    folder = Path(output)
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
        return Training(numbers=to_plain(full), shown=shown, draw=_no_curves, folder=folder)
    check_places(options)  # before PyTorch is imported, which takes many seconds
    with suspended_garbage_collection():
        from sprintlab.training.runs.run import train as run

    run(options)
    return _training_in(folder, chosen.robot)


def _chosen_settings(
    robot: Any,
    method: str | None,
    preset: str,
    file: Path | str | None,
    changes: Sequence[str],
    seed: int | None,
) -> TrainingSettings:
    """The settings of a training; the arguments are those of ``train``.

    Raises:
        InvalidValueError: the file is for another robot or method than the typed one.
    """
    from sprintlab.training import methods
    from sprintlab.training.settings import TrainingSettings
    from sprintlab.training.settings_text import read_settings, with_changes

    named = None
    if isinstance(robot, TrainingSettings):
        chosen = robot
    else:
        check_kind("robot", robot, str | Path | None)
        named = None if robot is None else _robot_word(robot)
        chosen = methods.method(method or methods.DEFAULT_METHOD, robot=named or "bp2", preset=preset)
    if file is not None:
        chosen = read_settings(Path(file), chosen)
        for name, typed in (("robot", named), ("method", method)):
            if typed not in (None, getattr(chosen, name)):
                raise InvalidValueError(name, typed, f"{file} is for {getattr(chosen, name)}")
    chosen = with_changes(chosen, changes)
    return chosen if seed is None else with_changes(chosen, {"seed": seed})


def _no_curves() -> Figure:
    raise SprintlabError("nothing was trained: there is no curve to draw")


def _training_in(folder: Path, robot: str) -> Training:
    """The training run of a folder, and what its policy reaches."""
    log = read_rows(folder / "log.jsonl", _LOG_LIMIT)

    def draw() -> Figure:
        from sprintlab.training.runs.figures import learning_curve

        return learning_curve(log)

    numbers = {"folder": str(folder), "iterations": len(log), **(log[-1] if log else {})}
    names = ("iterations", "seconds", "speed_median", "speed_p999", "range_upper", "reward", "falls")
    rows = ((name.replace("_", " "), f"{numbers[name]:.4g}") for name in names if name in numbers)
    shown: list[Any] = []
    if os.environ.get("RANK", "0") == "0":  # of several processes, one speaks
        remark("three trials in the plant tell what the policy reached")
        where = f"policy: {folder / 'policy.onnx'}"
        shown = [table(f"Training in {folder}", "what", "value", rows=rows), where]
        shown += what_was_reached(folder, robot)
    return Training(numbers=numbers, shown=shown, draw=draw, folder=folder)


@checked
def learning(
    run_folder: Path | str, *, output: Path | str | None = None, progress: Progress = silent
) -> Result:
    """Say how far a training run has come, and draw its curves and curriculum.

    It reads the run's checkpoint, also while the run goes on.

    Args:
        run_folder: folder of the run, with its checkpoint.pt, or a checkpoint.
        output: folder for the pictures; the run's own when left out.
        progress: called with what is being done.

    Raises:
        SprintlabError: there is no checkpoint, damaged, or a milestone, or the extra is missing.
    """
    require_training()
    from sprintlab.training.runs.checkpoint import read_checkpoint

    run = Path(run_folder)
    checkpoint = run / "checkpoint.pt" if run.is_dir() else run
    place = checkpoint.parent if output is None else Path(output)
    progress("reading the run", None)
    state = read_checkpoint(checkpoint)
    check_writable(place / "learning.png")
    from sprintlab.training.runs.figures import learning_figures, learning_numbers

    if "learner" not in state:
        raise SprintlabError(f"{checkpoint} is a milestone, which holds a policy and no curves")
    with refused_as_damaged(checkpoint):
        numbers = learning_numbers(state)
        progress("drawing", None)
        figures = list(map(str, learning_figures(state, place)))
    texts = {
        name: f"{value:.6g}" if isinstance(value, float) else str(value) for name, value in numbers.items()
    }
    rows = ((name.replace("_", " "), text, UNITS.get(name, "")) for name, text in texts.items())
    shown = [table(str(checkpoint), "what", "value", "unit", rows=rows), *figures]
    return Result(numbers={**numbers, "figures": figures}, shown=shown)


@checked
def export(
    checkpoint: Path | str,
    output: Path | str,
    *,
    braking_power: float | None = None,
    lead: float | None = None,
    turning_speed: float | None = None,
    progress: Progress = silent,
) -> Result:
    """Write a training checkpoint as one ONNX file that carries its own contract, checked against PyTorch.

    Args:
        checkpoint: checkpoint of a training run.
        output: the ONNX file to write.
        braking_power: the forward command that reaches the network falls no faster than this power for each
            kilogram of the robot [W/kg]; as it is given when left out.
        lead: the forward command that reaches the network runs no further ahead of the estimated speed [m/s],
            and falls as with the default of --braking-power; as far as it is given when left out.
        turning_speed: the network is asked for more than the commanded yaw rate, for twice as much at this
            forward speed [m/s], and a loop on the gyroscope adds what is still missing; without, for the one
            that is commanded.
        progress: called with what is being done.

    Raises:
        InvalidValueError: the power, the lead or the speed is out of range.
        SprintlabError: the checkpoint cannot be read, the runtimes differ, or the disk refuses.
    """
    require_training()
    from sprintlab.control.turning import TurningContract
    from sprintlab.training.runs.checkpoint import read_checkpoint

    checkpoint, output, pace = Path(checkpoint), Path(output), _pace(power=braking_power, lead=lead)
    turning = None if turning_speed is None else TurningContract(doubling_speed=turning_speed)
    if not checkpoint.is_file():
        raise SprintlabError(f"checkpoint {checkpoint} does not exist")
    if output.is_dir():
        raise SprintlabError(f"{output} is a folder: name the policy file to write (.onnx)")
    read_checkpoint(checkpoint)
    check_writable_file(output)
    progress("exporting", None)
    from sprintlab.training.runs.export import export_checkpoint

    made = export_checkpoint(checkpoint, output, pace, turning)
    compared = f"greatest difference from PyTorch: {made.difference:.1e}"
    numbers = {**made._asdict(), "path": str(made.path)}
    return Result(numbers=numbers, shown=[f"policy: {made.path}", compared], found=made)


def _pace(**given: float | None) -> PaceContract | None:
    from sprintlab.control.pace import PaceContract

    chosen = {name: value for name, value in given.items() if value is not None}
    return PaceContract(**chosen) if chosen else None


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

    Every run gets <output>/<method>/seed-<k>/ with all that a training leaves; with --vary there is a folder
    of that kind for each combination.

    Args:
        output: folder of the sweep.
        robot: name, folder or table of the robot.
        methods: to train; all six of the paper when left out.
        preset: sprintlab, or paper: the paper's reward table to the letter.
        seeds: number of seeds a method, from 0.
        set: a setting of every run that differs from the default, e.g. ppo.steps=16.
        vary: a setting and its values, e.g. ppo.learning_rate=0.001,0.0005; several make all combinations.
        minutes: training time of each run; as train has it when left out.
        iterations: at which each run ends.
        environments: robots side by side in each run; as train has it when left out.
        device: auto: all GPUs of this machine, or its CPU; or one of them: cuda:0, cpu.
        parallel: trainings that share a GPU, or the CPU; memory must allow it.
        retries: how often a run that failed or was killed is started again.
        dry_run: print the commands of the runs that are not finished, for a cluster's scheduler.
        progress: called with how many runs are finished.

    Raises:
        SprintlabError: an option is refused, a package is missing, or runs failed; the error's ``found`` then
            says how every run ended.
    """
    from sprintlab.training.methods import METHODS
    from sprintlab.training.runs.sweep import parse_variations, plan_sweep, train_all, training_devices

    check_range("seeds", seeds, 1, 1000)
    check_range("parallel", parallel, 1, 64)
    check_range("retries", retries, 0, 1000)
    runs = plan_sweep(
        Path(output), robot=_robot_word(robot), methods=tuple(methods) or tuple(METHODS), preset=preset,
        seeds=range(seeds), fixed=set, varied=parse_variations(vary), minutes=minutes, iterations=iterations,
        environments=environments, device=None if device == "auto" else device,
    )  # fmt: skip
    if dry_run:
        return _planned(runs)
    require_training()
    states = {run.name: "finished" if run.finished else "waiting" for run in runs}

    def watch(found: Mapping[str, str]) -> None:
        for name in [name for name in found if found[name] != states[name]]:
            remark(f"{name}: {found[name]}")
            states[name] = found[name]
        done = sum(state == "finished" for state in found.values())
        progress(f"{done} of {len(runs)} runs finished", done / len(runs))

    def result() -> Result:
        return _status(runs, states)

    try:
        train_all(runs, parallel * training_devices(device), retries, watch)
    except BaseException as error:
        error.found = result()  # pyright: ignore[reportAttributeAccessIssue]
        raise
    return result()


def _planned(runs: Sequence[SweptRun]) -> Result:
    """What a sweep would train: a command per run."""
    numbers = [
        {"run": run.name, "folder": str(run.folder), "done": run.finished, "command": run.command}
        for run in runs
    ]
    return Result(numbers=numbers, shown=[run.command for run in runs if not run.finished])


def _status(runs: Sequence[SweptRun], states: Mapping[str, str]) -> Result:
    """How every run of a sweep stands; the speed is that of the fastest 0.1 % of the robots."""
    columns = {"iteration": "iteration", "speed_p999": "fastest m/s", "falls": "falls per step"}
    made = table("sweep", "run", "state", *columns.values(), numbers=tuple(columns.values()))
    numbers = [
        {"run": run.name, "folder": str(run.folder), "state": states[run.name], "last": run.last_row()}
        for run in runs
    ]
    for row in numbers:
        cells = (f"{row['last'][name]:.4g}" if name in row["last"] else "-" for name in columns)
        made.add_row(row["run"], row["state"], *cells)
    return Result(numbers=numbers, shown=[made])
