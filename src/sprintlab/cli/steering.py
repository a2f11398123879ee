"""``sprintlab turning`` and ``sprintlab lap``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from sprintlab.api.drive import DriveOptions
from sprintlab.api.steering import TURNING_SPEEDS, lap, turning
from sprintlab.cli.output import progress_bar, show_result
from sprintlab.core.files import check_figure_path


@dataclass(frozen=True, kw_only=True)
class Turning:
    """Measure how much of a commanded yaw rate a policy turns with, at every speed.

    Yaw rates go up to what friction allows, |v w| = mu g, and at most 1 rad/s.

    Attributes:
        policy: a policy file, or the name of a policy that comes with the package.
        robot: a robot's name, or a parameter table of one's own (.toml); the policy's when left out.
        speeds: commanded forward speeds [m/s].
        workers: processes; one a core when left out.
        figure: also draw the map here (.png, .pdf or .svg).
        json: print JSON only.
        drive: motor model, battery and heat.
    """

    policy: tyro.conf.Positional[str]
    robot: str | None = None
    speeds: tuple[float, ...] = TURNING_SPEEDS
    workers: int | None = None
    figure: Path | None = None
    json: tyro.conf.FlagCreatePairsOff[bool] = False
    drive: tyro.conf.FlagCreatePairsOff[DriveOptions] = DriveOptions()

    def run(self) -> int:
        """Run every turn, print the map.

        Raises:
            SprintlabError: the policy, the robot or a setting is refused, or the simulation failed.
        """
        if self.figure is not None:
            check_figure_path(self.figure)
        with progress_bar(quiet=self.json) as report:
            report("loading", None)
            found = turning(
                self.policy,
                robot=self.robot,
                speeds=self.speeds,
                drive=self.drive,
                workers=self.workers,
                progress=report,
            )
        show_result(found, self.figure, self.json)
        return 0


@dataclass(frozen=True, kw_only=True)
class Lap:
    """Run one lap of a standard 400 m track in lane 1: time, lane, energy, heat.

    Attributes:
        policy: a policy file, or the name of a policy that comes with the package.
        top_speed: commanded speed [m/s].
        robot: a robot's name, or a parameter table of one's own (.toml); the policy's when left out.
        self_paced: hold the command within 1 m/s of the measured speed.
        figure: also draw the path here (.png, .pdf or .svg).
        json: print JSON only.
        drive: motor model, battery and heat.
    """

    policy: tyro.conf.Positional[str]
    top_speed: float = 10.0
    robot: str | None = None
    self_paced: tyro.conf.FlagCreatePairsOff[bool] = False
    figure: Path | None = None
    json: tyro.conf.FlagCreatePairsOff[bool] = False
    drive: tyro.conf.FlagCreatePairsOff[DriveOptions] = DriveOptions()

    def run(self) -> int:
        """Run the lap, print its numbers; 1 where the robot fell.

        Raises:
            SprintlabError: the policy, the robot or a setting is refused, or the simulation failed.
        """
        if self.figure is not None:
            check_figure_path(self.figure)
        with progress_bar(quiet=self.json) as report:
            report("running a lap", None)
            found = lap(
                self.policy, self.top_speed, robot=self.robot, self_paced=self.self_paced, drive=self.drive
            )
        show_result(found, self.figure, self.json)
        return 1 if found.found.trial.fall_reason else 0
