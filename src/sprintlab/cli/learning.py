"""``sprintlab learning``: how a training run went, as numbers and pictures."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from sprintlab.api.training import require_training
from sprintlab.cli.output import plain_table, print_json, progress_bar, stdout_console
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
"""Of the numbers that have one."""


@dataclass(frozen=True, kw_only=True)
class Learning:
    """Say how far a training run has come, and draw its curves, curriculum and speeds.

    It reads the run's checkpoint, also while the run goes on.

    Attributes:
        run_folder: folder of the run, with its checkpoint.pt.
        output: folder for the pictures; the run's own when left out.
        json: print JSON only.
    """

    run_folder: tyro.conf.Positional[Path]
    output: Path | None = None
    json: tyro.conf.FlagCreatePairsOff[bool] = False

    def run(self) -> int:
        """Print and draw.

        Raises:
            SprintlabError: there is no checkpoint, damaged, or a milestone, or the extra is missing.
        """
        require_training()
        checkpoint = self.run_folder / "checkpoint.pt" if self.run_folder.is_dir() else self.run_folder
        from sprintlab.core.files import check_writable
        from sprintlab.core.reading import refused_as_damaged
        from sprintlab.training.runs.checkpoint import check_checkpoint, read_checkpoint

        # Before PyTorch is imported, which takes many seconds.
        if "growth" not in check_checkpoint(checkpoint):
            raise SprintlabError(f"{checkpoint} is a milestone, which holds a policy and no curves")
        check_writable((self.output or checkpoint.parent) / "learning.png")
        with progress_bar(quiet=self.json) as report:
            report("reading the run", None)
            from sprintlab.training.runs.figures import learning_figures, learning_numbers

            state = read_checkpoint(checkpoint)
            with refused_as_damaged(checkpoint):
                numbers = learning_numbers(state)
                report("drawing", None)
                pictures = learning_figures(checkpoint, self.output or checkpoint.parent)
        if self.json:
            print_json({**numbers, "figures": [str(path) for path in pictures]})
            return 0
        table = plain_table(f"{checkpoint}", "what", "value", "unit", numbers=("value",))
        for name, value in numbers.items():
            text = f"{value:.6g}" if isinstance(value, float) else str(value)
            table.add_row(name.replace("_", " "), text, UNITS.get(name, ""))
        stdout_console().print(table)
        for path in pictures:
            stdout_console().print(path, soft_wrap=True)
        return 0
