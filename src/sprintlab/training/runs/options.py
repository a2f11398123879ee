"""What a training is asked to do, and whether it can begin: known at once, without PyTorch."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

from sprintlab.core.checks import check_positive, check_range
from sprintlab.core.errors import InvalidValueError, SprintlabError
from sprintlab.core.files import check_writable
from sprintlab.robots import load_robot
from sprintlab.training.runs.checkpoint import MOST_ITERATIONS, Progress, read_checkpoint
from sprintlab.training.settings import MOST_ENVIRONMENTS, TrainingSettings, settings_for_cpu

POLICY_NAME, RUN_FILE = "policy.onnx", "run.toml"
"""In the folder of a run: its exported policy, and its settings, written when its kernels are ready."""
GPU_ITERATIONS, CPU_MINUTES = 3600, 60.0
"""Length of a run that says neither minutes nor iterations."""
_GPU_FILES = ("/dev/nvidiactl", "/dev/nvhost-gpu", "/dev/dxg")


@dataclass(frozen=True, kw_only=True)
class RunLength:
    """When a run ends: its phases begin at shares of this."""

    iterations: int | None = None  # iterations of the run; None: as many as fit into the time
    seconds: float | None = None  # training time of the run, over all sessions [s]; None: no limit

    def share(self, progress: Progress) -> float:
        """Share of the run that is done, from 0 to 1."""
        shares = [0.0]
        if self.iterations is not None:
            shares.append(progress.iteration / self.iterations)
        if self.seconds is not None:
            shares.append(progress.seconds / self.seconds)
        return min(1.0, max(shares))


@dataclass(frozen=True, kw_only=True)
class TrainOptions:
    """A session of training: what is trained, for how long, and where to; ``api.training.train`` says more.

    On a CPU settings of the default size become small ones. Without minutes and iterations a resumed run
    keeps its length.
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
    fused: bool = True
    tensorboard: bool = True
    wandb: str | None = None

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
            raise InvalidValueError("wandb", self.wandb, "it copies the curves that --plain leaves out")

    @property
    def checkpoint(self) -> Path:
        """The newest checkpoint of the run."""
        return self.output / "checkpoint.pt"

    @property
    def on_cpu(self) -> bool:
        """Whether the training runs on the CPU."""
        return self.device == "cpu" or (self.device == "auto" and not _has_gpu())

    def length(self, resumed: bool) -> RunLength | None:
        """When the run ends; None: a resumed run for which neither is given keeps its length."""
        minutes, iterations = self.minutes, self.iterations
        if minutes is None and iterations is None:
            if resumed:
                return None
            minutes, iterations = (CPU_MINUTES, None) if self.on_cpu else (None, GPU_ITERATIONS)
        return RunLength(iterations=iterations, seconds=None if minutes is None else 60.0 * minutes)

    def full_settings(self) -> TrainingSettings:
        """The settings at the size that this session trains."""
        settings = settings_for_cpu(self.settings) if self.on_cpu else self.settings
        if self.environments is None:
            return settings
        return replace(settings, simulation=replace(settings.simulation, environments=self.environments))


def check_places(options: TrainOptions) -> None:
    """Refuse a run that cannot begin: its device, robot or folder. Raises ``SprintlabError``."""
    _check_device(options.device)
    if options.checkpoint.exists():
        if not options.resume:
            raise SprintlabError(f"{options.checkpoint} exists: choose another --output, or --resume")
        read_checkpoint(options.checkpoint)
    load_robot(options.settings.robot)
    check_writable(options.checkpoint)


def _check_device(device: str) -> None:
    kind, _, number = device.partition(":")
    if device not in ("auto", "cpu", "cuda") and not (kind == "cuda" and number.isdecimal()):
        raise InvalidValueError("device", device, "choose one of auto, cpu, cuda, cuda:0, ...")
    if kind == "cuda" and not _has_gpu():
        raise SprintlabError(f"device {device} asked for, but this machine has no GPU")


def _has_gpu() -> bool:
    """Whether this machine has a GPU, known without PyTorch."""
    return any(Path(name).exists() for name in _GPU_FILES)
