"""``sprintlab figures``: the paper's figures from policies and results of one's own."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from sprintlab.cli.output import print_json, progress_bar
from sprintlab.core.errors import SprintlabError

if TYPE_CHECKING:
    from sprintlab.evaluation.ablation.gallery import Gallery


@dataclass(frozen=True, kw_only=True)
class Figures:
    """Draw the paper's figures from the policies that come with the package and the committed results.

    Attributes:
        out: folder for the PNG files.
        results: folder of finished runs (curves and evaluations); left out where it does not exist.
        policy: name of the shipped policy of the figures that show one policy.
        top_speed: commanded speed of every run [m/s].
        robot: a robot's name, or a parameter table of one's own (.toml).
        markdown: also put the pictures between the marks of this page.
        json: print the files as JSON only.
    """

    out: Path = Path("docs/figures")
    results: Path = Path("results/methods")
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
            from sprintlab.evaluation.ablation.gallery import gallery_text, write_gallery
            from sprintlab.evaluation.ablation.pages import check_sections, replace_section

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
        from sprintlab.evaluation.ablation.gallery import Gallery
        from sprintlab.evaluation.ablation.runs import find_runs, shipped_candidates
        from sprintlab.robots import load_robot

        check_positive("top_speed", self.top_speed, "m/s")
        policies = {one.method: one for one in shipped_candidates()}
        if self.policy not in policies:
            raise SprintlabError(
                f"no policy named {self.policy!r} (there is: {', '.join(policies) or 'none'})"
            )
        return Gallery(
            robot=load_robot(self.robot),
            policies=tuple(policies.values()),
            runs=tuple(find_runs(self.results)) if self.results.is_dir() else (),
            main=policies[self.policy],
            top_speed=self.top_speed,
        )
