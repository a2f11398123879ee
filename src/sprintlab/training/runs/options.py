"""What a training is asked to do, and whether it can begin: known at once, without PyTorch."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from sprintlab.commands import check_schedule
from sprintlab.core.checks import check_choice, check_positive, check_range
from sprintlab.core.errors import InvalidValueError, SprintlabError
from sprintlab.core.files import check_writable
from sprintlab.robots import load_robot
from sprintlab.training.methods import ALL_METHODS, PRESETS, method_settings, preset_settings
from sprintlab.training.runs.checkpoint import MOST_ITERATIONS, check_checkpoint, unknown_settings
from sprintlab.training.scaling import scaled_settings
from sprintlab.training.settings import MOST_ENVIRONMENTS, TrainingSettings, settings_for_cpu

_OWN_FOLDERS = ("milestones", "tensorboard", "wandb", ".wandb")
GPU_MINUTES, CPU_MINUTES = 7.0, 60.0
"""Length of a run that says neither minutes nor iterations."""
_MOST_MILESTONES = 1000
_GPU_FILES = ("/dev/nvidiactl", "/dev/nvhost-gpu", "/dev/dxg")


@dataclass(frozen=True, kw_only=True)
class TrainOptions:
    """What to train, how long, and where to.

    Attributes:
        method: sprint, baseline, no-envelope, simplified-dc, fixed-acceleration, uniform-commands;
            literal-acs: commands that follow the robot and move toward nothing; no-saturation; after other
            papers: rlvrl, lp-acrl, after-hacl, hound, stride-prior.
        robot: name, folder or table of the robot to train; lengths, speeds and masses of the settings are
            scaled to it where they are BP2's. bp2 when left out.
        preset: sprintlab, or paper: the paper's reward table to the letter, no copied states, no fast starts.
        output: folder of the run: checkpoint, log, ``run.toml`` and, at its end, ``policy.onnx``.
        minutes: stop after this much time in this session; the phases of the training follow it. Without
            minutes and iterations 7 on a GPU, 60 on a CPU.
        iterations: stop at this iteration of the run; at most 30,000.
        environments: robots side by side; 32768 on a GPU and 2048, with small networks, on a CPU when left
            out.
        seed: of every random generator.
        device: ``cuda:0``, ``cpu`` or ``auto``.
        resume: go on from the checkpoint in ``output``.
        save_seconds: time between checkpoints.
        milestones: keep the policy as it is at every multiple of this training time [s], as
            ``output/milestones/0030.pt`` and so on: how the speed came about can be measured afterwards.
        keep_schedule: take the command schedule from the settings instead of the method's default.
        keep_motor_model: take the motor model from the settings instead of the method's.
        keep_robots: put the state of every robot into the checkpoint (6 kB each): the run can then go on as
            if it had not stopped. Without, robots start from standing when it is taken up.
        fused: graphs and compiled kernels on a GPU; without them the same code runs plainly, and slowly.
        tensorboard: curves in ``output/tensorboard``: ``tensorboard --logdir runs``.
        wandb: project on Weights & Biases that gets the same curves (needs the extra ``wandb``).
        figures: at the end, pictures of the learning curve, the curriculum and the speeds in ``output``.
        settings: everything else; ``method``, ``environments`` and ``seed`` are put into it.

    Raises:
        InvalidValueError: an unknown method or a number out of range.
    """

    method: str = "sprint"
    robot: str | None = None
    preset: str = "sprintlab"
    output: Path = Path("runs/train")
    minutes: float | None = None
    iterations: int | None = None
    environments: int | None = None
    seed: int = 0
    device: str = "auto"
    resume: bool = False
    save_seconds: float = 60.0
    milestones: float | None = None
    keep_schedule: bool = False
    keep_motor_model: bool = False
    keep_robots: bool = False
    fused: bool = True
    tensorboard: bool = True
    wandb: str | None = None
    figures: bool = False
    settings: TrainingSettings = TrainingSettings()

    def __post_init__(self) -> None:
        check_choice("method", self.method, tuple(ALL_METHODS))
        check_choice("preset", self.preset, PRESETS)
        if self.minutes is not None:
            check_positive("minutes", self.minutes, "min")
        if self.iterations is not None:
            check_range("iterations", self.iterations, 1, MOST_ITERATIONS)
        check_range("seed", self.seed, 0, 2**32 - 1)
        check_range("save_seconds", self.save_seconds, 0.0, 1e9, "s")
        if self.milestones is not None:
            self._check_milestones(self.milestones)
        if self.environments is not None:
            check_range("environments", self.environments, 2, MOST_ENVIRONMENTS)
        if self.wandb is not None and not self.tensorboard:
            raise InvalidValueError("wandb", self.wandb, "None without tensorboard, whose curves it copies")

    def _check_milestones(self, interval: float) -> None:
        """Refuse more files than a run needs: the options may come from a file, and would fill the disk."""
        check_range("milestones", interval, 1.0, 1e6, "s")
        seconds = self.seconds()
        count = min(math.inf if seconds is None else seconds / interval, self.iterations or MOST_ITERATIONS)
        if count > _MOST_MILESTONES and seconds is not None:
            least = f"{seconds / 60.0:g} minutes may keep {_MOST_MILESTONES} policies"
            reason = f"{least}, one every {seconds / _MOST_MILESTONES:.3g} s or less often"
            raise InvalidValueError("milestones", interval, reason)

    @property
    def on_cpu(self) -> bool:
        """Whether the training runs on the CPU."""
        return self.device == "cpu" or (self.device == "auto" and not _has_gpu())

    def seconds(self) -> float | None:
        """Length of this session [s]; None where only the iterations end it."""
        if self.minutes is not None:
            return 60.0 * self.minutes
        if self.iterations is not None:
            return None
        return 60.0 * (CPU_MINUTES if self.on_cpu else GPU_MINUTES)

    def full_settings(self) -> TrainingSettings:
        """The settings with method, environments and seed in place."""
        chosen = preset_settings(self.preset, self.settings)
        if self.robot is not None:
            chosen = scaled_settings(self.robot, chosen, preset_settings(self.preset))
        if self.on_cpu:
            chosen = settings_for_cpu(chosen)
        environments = self.environments or chosen.simulation.environments
        simulation = replace(chosen.simulation, environments=environments)
        base = replace(chosen, simulation=simulation, seed=self.seed)
        settings = method_settings(self.method, base)
        if self.keep_motor_model:
            settings = replace(settings, actuator_model=base.actuator_model)
        return replace(settings, schedule=base.schedule) if self.keep_schedule else settings

    def check_kept(self, chosen: Mapping[str, Any], way: str) -> None:
        """Refuse settings that the method would silently replace.

        Args:
            chosen: names of settings, and what was written for them.
            way: how to keep one, with ``{name}`` (keep_schedule) or ``{option}`` in it.

        Raises:
            InvalidValueError: names the first of them.
        """
        for name, switch in (("schedule", "keep_schedule"), ("actuator_model", "keep_motor_model")):
            if name not in chosen or getattr(self, switch):
                continue
            if getattr(self.full_settings(), name) != getattr(self.settings, name):
                option = "--" + switch.replace("_", "-")
                reason = f"method {self.method} decides it: {way.format(name=switch, option=option)}"
                raise InvalidValueError(name, chosen[name], reason)


def check_places(options: TrainOptions, restartable: bool = False) -> None:
    """Refuse a run that cannot begin: its device, robot or folder.

    Args:
        options: of the run.
        restartable: whether a checkpoint in the folder is gone on from.

    Raises:
        SprintlabError: names what is in the way.
    """
    _check_device(options.device)
    checkpoint = options.output / "checkpoint.pt"
    if options.resume and not checkpoint.is_file():
        raise SprintlabError(f"there is nothing to resume: no {checkpoint}")
    if checkpoint.exists() and not (options.resume or restartable):
        raise SprintlabError(f"{checkpoint} exists: choose another output, or resume it")
    load_robot(options.robot or options.settings.robot)
    if options.resume:
        check_checkpoint(checkpoint)
    if not unknown_settings(options.settings.schedule):
        check_schedule(options.settings.schedule)
    check_writable(options.output / "checkpoint.pt")
    _check_own_folders(options.output)
    if options.wandb is not None:
        _check_settings_of_wandb()


def _check_own_folders(output: Path) -> None:
    """In a run folder that came from elsewhere, a link would lead what the run writes to another place."""
    for folder in (output / name for name in _OWN_FOLDERS):
        if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
            raise SprintlabError(f"{folder} is no folder of the run, and its name is needed: move it away")


def _check_settings_of_wandb() -> None:
    """wandb obeys a file in the working folder, which may come from elsewhere.

    It says to whom curves and the account's key go, and that the folder's code is saved: for that wandb
    calls git, which runs what the folder's own ``.git/config`` names.
    """
    for path in (Path("wandb", "settings"), Path(".wandb", "settings")):
        if os.path.lexists(path):
            raise SprintlabError(
                f"{path} in the working folder would say where the curves are sent: move it away, or start "
                "elsewhere; your own settings belong into ~/.config/wandb/settings or WANDB_... variables"
            )


def _check_device(device: str) -> None:
    kind, _, number = device.partition(":")
    if device not in ("auto", "cpu", "cuda") and not (kind == "cuda" and number.isdecimal()):
        raise InvalidValueError("device", device, "choose one of auto, cpu, cuda, cuda:0, ...")
    if kind == "cuda" and not _has_gpu():
        raise SprintlabError(f"device {device} asked for, but this machine has no GPU")


def _has_gpu() -> bool:
    """Whether this machine has a GPU, known without PyTorch."""
    return any(Path(name).exists() for name in _GPU_FILES)
