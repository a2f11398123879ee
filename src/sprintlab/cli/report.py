"""``sprintlab report``: a log of a run as figures and one HTML page, beside its simulation."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from sprintlab.api.run_reports import report_run
from sprintlab.cli.output import measure


@dataclass(frozen=True, kw_only=True)
class Report:
    """Draw a log of ``sprintlab run``, with the same commands in simulation beside it.

    Attributes:
        log: the log (.mcap).
        robot: a robot's name, or a parameter table of one's own (.toml); the log's when left out.
        policy: the policy to simulate; the log's when left out.
        out: result folder; runs/report-<date>-<time> when left out.
        distance: of the sprint [m].
        no_simulation: draw the log alone.
        json: print JSON only.
    """

    log: tyro.conf.Positional[Path]
    robot: str | None = None
    policy: str | None = None
    out: Path | None = None
    distance: float = 100.0
    no_simulation: tyro.conf.FlagCreatePairsOff[bool] = False
    json: tyro.conf.FlagCreatePairsOff[bool] = False

    def run(self) -> int:
        """Read, simulate, draw, print.

        Raises:
            SprintlabError: the log, the robot, the policy or the folder is refused.
        """
        measure(
            lambda out, no_simulation, **options: report_run(
                folder=out, simulate=not no_simulation, **options
            ),
            self,
        )
        return 0
