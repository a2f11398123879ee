"""``sprintlab learning``: how a training run went, as numbers and pictures."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from sprintlab.api.learning import learning
from sprintlab.cli.output import progress_bar, show, stdout_console


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
        with progress_bar(quiet=self.json) as report:
            found = learning(self.run_folder, self.output, progress=report)
        show(found, self)
        if not self.json:
            for path in found.figures:
                stdout_console().print(path, soft_wrap=True)
        return 0
