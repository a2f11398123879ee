"""``sprintlab turning`` and ``sprintlab lap``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from sprintlab.api.drive import DriveOptions
from sprintlab.api.steering import TURNING_SPEEDS, lap, turning
from sprintlab.cli.output import measure


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
        measure(turning, self)
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
        return 1 if measure(lap, self).found.trial.fall_reason else 0
