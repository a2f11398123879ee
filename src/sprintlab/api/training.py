"""``method``, ``train``, ``export``: from settings to a policy file."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from rich.console import RenderableType

from sprintlab.api.policies import robot_word
from sprintlab.api.processes import leave_to_the_parent
from sprintlab.api.tables import Drawn, in_notebook, plain_table
from sprintlab.core.arguments import checked
from sprintlab.core.errors import SprintlabError
from sprintlab.core.extras import require_package
from sprintlab.core.reading import read_rows

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sprintlab.training.settings import TrainingSettings

_LOG_LIMIT = 64 << 20
NEEDED = ("torch",)


@dataclass(frozen=True, kw_only=True)
class Training(Drawn):
    """A training run; prints how far it has come, draws its curves, names its policy."""

    folder: Path
    """Of the run: checkpoint, log, settings."""

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

    def to_dict(self) -> dict[str, Any]:
        """The last row of the log, with the folder and the number of iterations."""
        rows = self.log()
        return {"folder": str(self.folder), "iterations": len(rows), **(rows[-1] if rows else {})}

    def tables(self) -> Iterator[RenderableType]:
        """How far the run has come."""
        shown = ("iterations", "seconds", "speed_median", "speed_p999", "range_upper", "reward", "falls")
        numbers = self.to_dict()
        rows = ((name.replace("_", " "), f"{numbers[name]:.4g}") for name in shown if name in numbers)
        yield plain_table(f"Training in {self.folder}", "what", "value", rows=rows)

    def plot(self) -> Figure:
        """Speeds, falls and reward over the training time."""
        require_training()
        from sprintlab.training.runs.figures import learning_curve

        return in_notebook(learning_curve(self.log()))

    def export(self, output: Path | str | None = None) -> Path:
        """The policy of the newest checkpoint as one ONNX file, compared with PyTorch before it counts.

        A training does this by itself at its end; one that was stopped has not.

        Args:
            output: the file; ``policy.onnx`` in the run's folder when left out.

        Raises:
            SprintlabError: the checkpoint cannot be read, the runtimes differ, or the disk refuses.
        """
        return export(self.checkpoint, self.policy if output is None else output)


@checked
def method(
    name: str = "sprint",
    changes: Mapping[str, Any] | None = None,
    *,
    robot: str | Path | None = None,
    environments: int | None = None,
    seed: int = 0,
) -> TrainingSettings:
    """The settings of a training method, changed where wanted; every choice of a run is a field of them.

    Args:
        name: sprint, baseline, no-envelope, simplified-dc, fixed-acceleration or uniform-commands.
        changes: dotted names of settings to values, e.g. ``{"ppo.steps": 16}``.
        robot: name, folder or table, with lengths, speeds and masses scaled to it; bp2 when left out.
        environments: robots side by side.
        seed: of every random generator.

    Raises:
        SprintlabError: an unknown method or setting, or a value that is not allowed.
    """
    from sprintlab.training import methods
    from sprintlab.training.settings_text import with_changes

    settings = methods.method(name, robot="bp2" if robot is None else robot_word(robot), seed=seed)
    sized = {} if environments is None else {"simulation.environments": environments}
    return with_changes(settings, {**sized, **(changes or {})})


@checked
def train(
    settings: TrainingSettings | str = "sprint",
    output: Path | str = "runs/train",
    *,
    iterations: int | None = None,
    minutes: float | None = None,
    device: str = "auto",
    resume: bool = False,
    **options: Any,
) -> Training:
    """Train a policy until the iterations or the time are used up, and export it.

    Args:
        settings: of the run, from ``method``; or a method's name.
        output: folder of the run.
        iterations: stop at this iteration of the run.
        minutes: stop after this time; without it and iterations after 7 minutes on a GPU, 60 on a CPU.
        device: ``cuda:0``, ``cpu`` or ``auto``.
        resume: go on from the checkpoint in ``output``.
        options: further fields of ``TrainOptions``, e.g. ``milestones`` or ``tensorboard``.

    Raises:
        SprintlabError: the extra is not installed, or a setting or the folder is refused.
    """
    leave_to_the_parent()
    settings = method(settings) if isinstance(settings, str) else settings
    train_settings(
        settings,
        output=Path(output),
        iterations=iterations,
        minutes=minutes,
        device=device,
        resume=resume,
        **options,
    )
    return Training(folder=Path(output))


@checked
def export(checkpoint: Path | str, output: Path | str) -> Path:
    """A training checkpoint as one ONNX file with its contract; see ``Training.export``.

    Args:
        checkpoint: of a training run.
        output: the file to write.

    Raises:
        SprintlabError: the checkpoint cannot be read, the runtimes differ, or the disk refuses.
    """
    require_training()
    check_export(Path(checkpoint), Path(output))
    from sprintlab.training.runs.export import export_checkpoint

    return export_checkpoint(Path(checkpoint), Path(output)).path


def check_export(checkpoint: Path, output: Path) -> None:
    """Refuse at once what can be seen without PyTorch, whose import takes many seconds.

    Raises:
        SprintlabError: the checkpoint cannot be read, or the policy cannot be written.
    """
    from sprintlab.core.files import check_writable_file
    from sprintlab.training.runs.checkpoint import check_checkpoint

    if not checkpoint.is_file():
        raise SprintlabError(f"checkpoint {checkpoint} does not exist")
    if output.is_dir():
        raise SprintlabError(f"{output} is a folder: name the policy file to write (.onnx)")
    check_checkpoint(checkpoint)
    check_writable_file(output)


def require_training() -> None:
    """Refuse with one sentence where the training extra is not installed.

    Raises:
        SprintlabError: names a missing package and how to install it.
    """
    for name in NEEDED:
        require_package(name, extra="train", use="training")


@dataclass(frozen=True, kw_only=True)
class ScriptOptions:
    """What a training script reads from its command line; its own defaults are an instance.

    Attributes:
        output: folder of the run.
        minutes: stop after this much time; without it and iterations 7 on a GPU, 60 on a CPU.
        iterations: stop at this iteration of the run.
        environments: robots side by side; the settings' when left out.
        seed: of every random generator; the settings' when left out.
        device: ``cuda:0``, ``cpu`` or ``auto``.
        resume: go on from the checkpoint in ``output``.
    """

    output: Path
    minutes: float | None = None
    iterations: int | None = None
    environments: int | None = None
    seed: int | None = None
    device: str = "auto"
    resume: bool = False


Options = TypeVar("Options", bound=ScriptOptions)


def run_script(main: Callable[[Options], object], defaults: Options) -> None:
    """Run the main function of a training script: parse its options, print what it returns.

    Args:
        main: gets the options.
        defaults: of the options; their class may add some to those of ``ScriptOptions``.

    Raises:
        SystemExit: 2, after one sentence on stderr, where something is refused.
    """
    import tyro

    try:
        print(main(tyro.cli(type(defaults), default=defaults)))
    except SprintlabError as error:
        print(f"{Path(sys.argv[0]).name}: {error}", file=sys.stderr)
        raise SystemExit(2) from error


def train_settings(settings: TrainingSettings, **options: Any) -> Path:
    """Train with settings made by a script; returns the checkpoint.

    Args:
        settings: of the run.
        options: fields of ``TrainOptions``, and ``seed``; those that are None are left out.

    Raises:
        SprintlabError: the extra is not installed, or an option or the output folder is refused.
    """
    require_training()
    from sprintlab.core.arguments import check_kind
    from sprintlab.training.runs.options import TrainOptions, check_places
    from sprintlab.training.settings import TrainingSettings

    check_kind("settings", settings, TrainingSettings)
    given = {name: value for name, value in options.items() if value is not None}
    seed = given.pop("seed", settings.seed)
    wanted = TrainOptions(settings=replace(settings, seed=seed), **given)
    check_places(wanted)  # before PyTorch is imported, which takes many seconds
    from sprintlab.training.runs.run import train

    return train(wanted)
