"""Trainings from a program: what they need, and how a script runs one."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sprintlab.core.errors import SprintlabError

if TYPE_CHECKING:
    from sprintlab.training.settings import TrainingSettings

NEEDED = ("torch", "warp", "mujoco_warp", "rsl_rl")
MISSING = "training needs packages that are not installed ({names}): pip install 'sprintlab[train]'"


def require_training() -> None:
    """Refuse with one sentence where the training extra is not installed.

    Raises:
        SprintlabError: names the missing packages and how to install them.
    """
    missing = [name for name in NEEDED if importlib.util.find_spec(name) is None]
    if missing:
        raise SprintlabError(MISSING.format(names=", ".join(missing)))


def run_script(main: Callable[[Any], object], options: type[Any]) -> None:
    """Run the main function of a training script: parse its options, print what it returns.

    Raises:
        SystemExit: 2, after one sentence on stderr, where something is refused.
    """
    import tyro

    try:
        print(main(tyro.cli(options)))
    except SprintlabError as error:
        print(f"{Path(sys.argv[0]).name}: {error}", file=sys.stderr)
        raise SystemExit(2) from error


def train_settings(settings: TrainingSettings, **options: Any) -> Path:
    """Train with settings made by a script; returns the checkpoint.

    Args:
        settings: of the run.
        options: fields of ``TrainOptions``.

    Raises:
        SprintlabError: the extra is not installed, or an option or the output folder is refused.
    """
    require_training()
    from sprintlab.training.run import TrainOptions, train

    return train(TrainOptions(settings=settings, **options))
