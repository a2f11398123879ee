"""``python -m studies.paper figures``: the paper's figures from policies and results of one's own."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from sprintlab.cli.output import print_json, progress_bar
from sprintlab.core.errors import SprintlabError

if TYPE_CHECKING:
    from studies.paper.gallery import Gallery


@dataclass(frozen=True, kw_only=True)
class Figures:
    """Draw the paper's figures from the runs of the study.

    Attributes:
        out: folder for the PNG files.
        results: folder of finished runs, each with its policy, curve and evaluation.
        policy: method of the figures that show one policy; its first seed runs.
        top_speed: commanded speed of every run [m/s].
        robot: a robot's name, or a parameter table of one's own (.toml).
        markdown: also put the pictures between the marks of this page.
        json: print the files as JSON only.
    """

    out: Path = Path("docs/figures")
    results: Path = Path("runs/study")
    policy: str = "sprint"
    top_speed: float = 12.0
    robot: str = "bp2"
    markdown: Path | None = None
    json: tyro.conf.FlagCreatePairsOff[bool] = False

    def run(self) -> int:
        """Simulate, draw, write.

        Raises:
            SprintlabError: the policy, the robot or a result is refused, or the disk refuses.
        """
        with progress_bar(quiet=self.json) as report:
            report("loading", None)
            from studies.paper.gallery import gallery_text, write_gallery
            from studies.paper.pages import check_sections, replace_section

            if self.markdown is not None:
                check_sections(self.markdown, ("figures",))
            drawings = write_gallery(self._gallery(), self.out, report)
        files = [self.out / f"{drawing.name}.png" for drawing in drawings]
        if self.markdown is not None:
            folder = Path(os.path.relpath(self.out, self.markdown.parent)).as_posix()
            replace_section(self.markdown, "figures", gallery_text(drawings, folder))
        if self.json:
            print_json({"figures": [str(path) for path in files]})
        else:
            for path in files:
                print(path)
        return 0

    def _gallery(self) -> Gallery:
        from sprintlab.core.checks import check_positive
        from sprintlab.core.files import check_writable
        from sprintlab.robots import load_robot
        from studies.paper.gallery import Gallery
        from studies.paper.measure import Candidate
        from studies.paper.runs import find_runs

        check_positive("top_speed", self.top_speed, "m/s")
        check_writable(self.out / "figure.png")
        runs = find_runs(self.results)
        policies: dict[str, Candidate] = {}
        for run in runs:
            if run.policy.is_file():
                policies.setdefault(
                    run.method, Candidate(method=run.method, seed=run.seed, policy=run.policy)
                )
        if self.policy not in policies:
            raise SprintlabError(
                f"no policy named {self.policy!r} (there is: {', '.join(policies) or 'none'})"
            )
        return Gallery(
            robot=load_robot(self.robot),
            policies=tuple(policies.values()),
            runs=tuple(runs),
            main=policies[self.policy],
            top_speed=self.top_speed,
        )
