"""What a training is asked to do, and whether it can begin: known at once, without PyTorch."""

from __future__ import annotations

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
from sprintlab.training.runs.policy_start import is_policy_file, read_policy_start
from sprintlab.training.scaling import scaled_settings
from sprintlab.training.settings import MOST_ENVIRONMENTS, TrainingSettings

_OWN_FOLDERS = ("milestones", "tensorboard", "wandb", ".wandb")
_CRITIC_ITERATIONS = 150
_MOST_MILESTONES = 1000
_GPU_FILES = ("/dev/nvidiactl", "/dev/nvhost-gpu", "/dev/dxg")


@dataclass(frozen=True, kw_only=True)
class TrainOptions:
    """What to train, how long, and where to.

    Attributes:
        method: sprint, baseline, no-envelope, simplified-dc, fixed-acceleration, uniform-commands;
            literal-acs: commands that follow the robot and move toward nothing; no-saturation; after other
            papers: rlvrl, lp-acrl, after-hacl, hound, spot-battery, actuator-network, stride-prior,
            flux-weakening.
        robot: name, folder or table of the robot to train; lengths, speeds and masses of the settings are
            scaled to it where they are BP2's. bp2 when left out.
        preset: sprintlab, or paper: the paper's reward table to the letter, no copied states, no fast starts.
        output: folder of the run: checkpoint, log, ``run.toml`` and, at its end, ``policy.onnx``.
        minutes: stop after this much time in this session.
        iterations: stop at this iteration of the run, after ``stages.steady_iteration``; at most 30,000.
        environments: robots side by side.
        seed: of every random generator.
        device: ``cuda:0``, ``cpu`` or ``auto``.
        resume: go on from the checkpoint in ``output``.
        start_from: another run's checkpoint whose networks and curriculum this run begins with; or a policy
            file (.onnx), which has no critic: that begins anew, with the whole range of speeds.
        critic_iterations: after a start from a policy file, the policy rests for so many iterations, in which
            only critic and decoder learn.
        save_seconds: time between checkpoints.
        milestones: keep the policy as it is at every multiple of this training time [s], as
            ``output/milestones/0030.pt`` and so on: how the speed came about can be measured afterwards.
        keep_schedule: take the command schedule from the settings instead of the method's default.
        keep_motor_model: take the motor model from the settings instead of the method's.
        keep_robots: put the state of every robot into the checkpoint (2 kB each): the run can then go on as
            if it had not stopped. Without, robots start from standing when it is taken up.
        fused: graphs and compiled kernels on a GPU; without them the same code runs plainly, and slowly.
        tensorboard: curves in ``output/tensorboard``: ``tensorboard --logdir runs``.
        wandb: project on Weights & Biases that gets the same curves (needs the extra ``wandb``).
        figures: at the end, pictures of the learning curve, the curriculum and the speeds in ``output``.
        cloud: at the end, two more seconds of the robots for ``cloud.npz``: where their motors work.
        settings: everything else; ``method``, ``environments`` and ``seed`` are put into it.

    Raises:
        InvalidValueError: an unknown method or a number out of range.
    """

    method: str = "sprint"
    robot: str | None = None
    preset: str = "sprintlab"
    output: Path = Path("runs/train")
    minutes: float = 20.0
    iterations: int = 1600
    environments: int = 8192
    seed: int = 0
    device: str = "auto"
    resume: bool = False
    start_from: Path | None = None
    critic_iterations: int = _CRITIC_ITERATIONS
    save_seconds: float = 60.0
    milestones: float | None = None
    keep_schedule: bool = False
    keep_motor_model: bool = False
    keep_robots: bool = True
    fused: bool = True
    tensorboard: bool = True
    wandb: str | None = None
    figures: bool = False
    cloud: bool = True
    settings: TrainingSettings = TrainingSettings()

    def __post_init__(self) -> None:
        check_choice("method", self.method, tuple(ALL_METHODS))
        check_choice("preset", self.preset, PRESETS)
        check_positive("minutes", self.minutes, "min")
        check_range("iterations", self.iterations, 1, MOST_ITERATIONS)
        check_range("seed", self.seed, 0, 2**32 - 1)
        check_range("save_seconds", self.save_seconds, 0.0, 1e9, "s")
        if self.milestones is not None:
            self._check_milestones(self.milestones)
        check_range("environments", self.environments, 2, MOST_ENVIRONMENTS)
        check_range("critic_iterations", self.critic_iterations, 0, 10**6)
        if self.critic_iterations != _CRITIC_ITERATIONS and not is_policy_file(self.start_from):
            reason = f"{_CRITIC_ITERATIONS} unless start_from is a policy file (.onnx)"
            raise InvalidValueError("critic_iterations", self.critic_iterations, reason)
        if self.wandb is not None and not self.tensorboard:
            raise InvalidValueError("wandb", self.wandb, "None without tensorboard, whose curves it copies")

    def _check_milestones(self, interval: float) -> None:
        """Refuse more files than a run needs: the options may be a stranger's, and would fill the disk."""
        check_range("milestones", interval, 1.0, 1e6, "s")
        count = min(60.0 * self.minutes / interval, self.iterations)
        if count > _MOST_MILESTONES:
            least = f"{self.minutes:g} minutes may keep {_MOST_MILESTONES} policies"
            reason = f"{least}, one every {60.0 * self.minutes / _MOST_MILESTONES:.3g} s or less often"
            raise InvalidValueError("milestones", interval, reason)

    def full_settings(self) -> TrainingSettings:
        """The settings with method, environments and seed in place."""
        chosen = preset_settings(self.preset, self.settings)
        if self.robot is not None:
            chosen = scaled_settings(self.robot, chosen, preset_settings(self.preset))
        simulation = replace(chosen.simulation, environments=self.environments)
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
    """Refuse a run that cannot begin: its device, robot, folder, or what it starts from.

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
    for source in (checkpoint if options.resume else None, options.start_from):
        if source is not None:
            _check_source(source, options)
    if not unknown_settings(options.settings.schedule):
        check_schedule(options.settings.schedule)
    check_writable(options.output / "checkpoint.pt")
    _check_own_folders(options.output)
    if options.wandb is not None:
        _check_settings_of_wandb()


def _check_source(path: Path, options: TrainOptions) -> None:
    """Refuse a checkpoint or policy file from which this training cannot go on."""
    if is_policy_file(path):
        read_policy_start(path, options.full_settings(), options.iterations)
    elif "growth" not in check_checkpoint(path):
        raise SprintlabError(f"{path} is a milestone, which holds a policy only: export it")


def _check_own_folders(output: Path) -> None:
    """In a run folder that came from elsewhere, a link would lead what the run writes to another place."""
    for folder in (output / name for name in _OWN_FOLDERS):
        if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
            raise SprintlabError(f"{folder} is no folder of the run, and its name is needed: move it away")


def _check_settings_of_wandb() -> None:
    """wandb obeys a file in the working folder, which may be a stranger's.

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
    if kind == "cuda" and not any(Path(name).exists() for name in _GPU_FILES):
        raise SprintlabError(f"device {device} asked for, but this machine has no GPU")
