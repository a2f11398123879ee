"""What a training is asked to do, and whether it can begin: known at once, without PyTorch."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

from sprintlab.commands import check_schedule
from sprintlab.core.checks import check_positive, check_range
from sprintlab.core.errors import InvalidValueError, SprintlabError
from sprintlab.core.files import check_writable
from sprintlab.robots import load_robot
from sprintlab.training.runs.checkpoint import MOST_ITERATIONS, read_checkpoint
from sprintlab.training.settings import MOST_ENVIRONMENTS, TrainingSettings, settings_for_cpu

GPU_MINUTES, CPU_MINUTES = 7.0, 60.0
"""Length of a run that says neither minutes nor iterations."""
_GPU_FILES = ("/dev/nvidiactl", "/dev/nvhost-gpu", "/dev/dxg")


@dataclass(frozen=True, kw_only=True)
class TrainOptions:
    """A session of training: of what, how long, and where to.

    Attributes:
        settings: every choice of the run: ``training.methods.method``.
        output: folder of the run: checkpoint, log, ``run.toml`` and, at its end, ``policy.onnx``.
        minutes: stop after this much time in this session; the phases of the training follow it. Without
            minutes and iterations 7 on a GPU, 60 on a CPU.
        iterations: stop at this iteration of the run; at most 30,000.
        environments: robots side by side; those of the settings when left out.
        device: ``cuda:0``, ``cpu`` or ``auto``. On a CPU settings of the default size become small ones.
        resume: go on from the checkpoint in ``output``, with its settings.
        save_seconds: time between checkpoints.
        milestones: keep the policy as it is at every multiple of this training time [s], as
            ``output/milestones/0030.pt`` and so on: how the speed came about can be measured afterwards.
        keep_robots: put the state of every robot into the checkpoint (6 kB each): the run can then go on as
            if it had not stopped. Without, robots start from standing when it is taken up.
        fused: graphs and compiled kernels on a GPU; without them the same code runs plainly, and slowly.
        tensorboard: curves in ``output/tensorboard``: ``tensorboard --logdir runs``.
        wandb: project on Weights & Biases that gets the same curves (needs the extra ``wandb``).
        figures: at the end, pictures of the learning curve, the curriculum and the speeds in ``output``.

    Raises:
        InvalidValueError: a number out of range.
    """

    settings: TrainingSettings = field(default_factory=TrainingSettings)
    output: Path = Path("runs/train")
    minutes: float | None = None
    iterations: int | None = None
    environments: int | None = None
    device: str = "auto"
    resume: bool = False
    save_seconds: float = 60.0
    milestones: float | None = None
    keep_robots: bool = False
    fused: bool = True
    tensorboard: bool = True
    wandb: str | None = None
    figures: bool = False

    def __post_init__(self) -> None:
        if self.minutes is not None:
            check_positive("minutes", self.minutes, "min")
        if self.iterations is not None:
            check_range("iterations", self.iterations, 1, MOST_ITERATIONS)
        check_range("save_seconds", self.save_seconds, 0.0, 1e9, "s")
        if self.milestones is not None:
            check_range("milestones", self.milestones, 1.0, 1e6, "s")
        if self.environments is not None:
            check_range("environments", self.environments, 2, MOST_ENVIRONMENTS)
        if self.wandb is not None and not self.tensorboard:
            raise InvalidValueError("wandb", self.wandb, "None without tensorboard, whose curves it copies")

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
        """The settings at the size that this session trains."""
        settings = settings_for_cpu(self.settings) if self.on_cpu else self.settings
        if self.environments is None:
            return settings
        return replace(settings, simulation=replace(settings.simulation, environments=self.environments))


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
    load_robot(options.settings.robot)
    if options.resume:
        read_checkpoint(checkpoint)
    check_schedule(options.settings.schedule)
    check_writable(options.output / "checkpoint.pt")


def _check_device(device: str) -> None:
    kind, _, number = device.partition(":")
    if device not in ("auto", "cpu", "cuda") and not (kind == "cuda" and number.isdecimal()):
        raise InvalidValueError("device", device, "choose one of auto, cpu, cuda, cuda:0, ...")
    if kind == "cuda" and not _has_gpu():
        raise SprintlabError(f"device {device} asked for, but this machine has no GPU")


def _has_gpu() -> bool:
    """Whether this machine has a GPU, known without PyTorch."""
    return any(Path(name).exists() for name in _GPU_FILES)
