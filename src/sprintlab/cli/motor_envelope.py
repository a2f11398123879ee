"""``sprintlab motor envelope``: a joint's torque-speed envelope under every model, numbers and picture."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from sprintlab.api.envelopes import envelope
from sprintlab.cli.output import arguments, draw, show


@dataclass(frozen=True, kw_only=True)
class MotorEnvelope:
    """Print and draw the torque-speed envelope of a joint under every motor model, all four quadrants.

    Attributes:
        source: a motor file (TOML), the name of a robot, or an actuator of the library.
        joint: which motor of the robot: abad, hip, knee, or a full name such as RL_hip.
        bus_voltage: [V]; the robot's or actuator's own, or 60 for a motor file.
        gear_ratio: motor speed over joint speed; the robot's or actuator's own, or 1 for a motor file.
        gear_efficiency: the robot's or actuator's own, or 1 for a motor file.
        figure: picture to draw (.png, .pdf or .svg); none when left out.
        trajectory: trajectory.npz of a race, drawn over the envelope and compared with it.
        points: speeds in the table, from standstill to the no-load speed.
        json: print JSON only.
    """

    source: tyro.conf.Positional[str] = "bp2"
    joint: tyro.conf.Positional[str] = "hip"
    bus_voltage: float | None = None
    gear_ratio: float | None = None
    gear_efficiency: float | None = None
    figure: Path | None = None
    trajectory: Path | None = None
    points: int = 13
    json: tyro.conf.FlagCreatePairsOff[bool] = False

    def run(self) -> int:
        """Print the envelope; raises ``SprintlabError`` for an unknown source or a bad field."""
        found = envelope(**arguments(self))
        draw(found, self.figure)
        show(found, self, figure=self.figure)
        return 0
