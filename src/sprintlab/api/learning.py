"""``learning``: how a training run went, as numbers and pictures."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import RenderableType

from sprintlab.api.processes import Progress
from sprintlab.api.tables import Printed, plain_table
from sprintlab.api.training import require_training
from sprintlab.core.arguments import checked
from sprintlab.core.errors import SprintlabError

UNITS = {
    "environment_steps": "policy steps",
    "seconds": "s",
    "speed_median": "m/s",
    "speed_p95": "m/s",
    "speed_p999": "m/s",
    "range_upper": "m/s",
    "falls": "a robot and step",
}
"""Units by name."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Learning(Printed):
    """How far a training run has come."""

    checkpoint: Path
    """That the numbers are of."""
    numbers: dict[str, Any]
    """Steps, time [s], speeds [m/s] and falls."""
    figures: tuple[Path, ...]
    """Curves, curriculum and speeds, as far as the checkpoint holds them."""

    def to_dict(self) -> dict[str, Any]:
        """The numbers, and where the figures lie."""
        return {**self.numbers, "figures": [str(path) for path in self.figures]}

    def tables(self) -> Iterator[RenderableType]:
        """One row per number, then the pictures."""
        table = plain_table(f"{self.checkpoint}", "what", "value", "unit")
        for name, value in self.numbers.items():
            text = f"{value:.6g}" if isinstance(value, float) else str(value)
            table.add_row(name.replace("_", " "), text, UNITS.get(name, ""))
        yield table
        yield from map(str, self.figures)


@checked
def learning(
    run_folder: Path | str,
    output: Path | str | None = None,
    *,
    progress: Progress = lambda what, share: None,
) -> Learning:
    """Say how far a training run has come, and draw its curves, curriculum and speeds.

    It reads the run's checkpoint, also while the run goes on.

    Args:
        run_folder: folder of the run, with its checkpoint.pt, or a checkpoint.
        output: folder for the pictures; the run's own when left out.
        progress: called with what is being done.

    Raises:
        SprintlabError: there is no checkpoint, damaged, or a milestone, or the extra is missing.
    """
    require_training()
    from sprintlab.core.files import check_writable
    from sprintlab.core.reading import refused_as_damaged
    from sprintlab.training.runs.checkpoint import check_checkpoint, read_checkpoint

    run = Path(run_folder)
    checkpoint = run / "checkpoint.pt" if run.is_dir() else run
    place = checkpoint.parent if output is None else Path(output)
    # Before PyTorch is imported, which takes many seconds.
    check_checkpoint(checkpoint)
    check_writable(place / "learning.png")
    progress("reading the run", None)
    from sprintlab.training.runs.figures import learning_figures, learning_numbers

    state = read_checkpoint(checkpoint)
    if "growth" not in state:
        raise SprintlabError(f"{checkpoint} is a milestone, which holds a policy and no curves")
    with refused_as_damaged(checkpoint):
        numbers = learning_numbers(state)
        progress("drawing", None)
        pictures = learning_figures(checkpoint, place, state)
    return Learning(checkpoint=checkpoint, numbers=numbers, figures=tuple(pictures))
