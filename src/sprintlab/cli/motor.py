"""``sprintlab motor``: from a data sheet or a bench to a motor, and what it can give at which speed."""

from __future__ import annotations

from dataclasses import dataclass

import tyro

from sprintlab.api.envelopes import envelope
from sprintlab.api.identification import identify_motor
from sprintlab.api.motors import chosen_motor
from sprintlab.cli.build import FIGURE, command, group
from sprintlab.cli.motor_datasheet import MotorFromDatasheet
from sprintlab.cli.motor_library import MotorLibrary
from sprintlab.cli.output import arguments, show

UNTRUSTED = 1
"""Status where the model does not describe the data."""


@dataclass(frozen=True, kw_only=True)
class MotorShow:
    """Print a motor's parameters and the speeds that follow from them, motor side.

    Attributes:
        source: a motor file (TOML), the name of a robot, or an actuator of the library.
        joint: which motor of the robot: abad, hip, knee, or a full name such as RL_hip.
        bus_voltage: [V]; the robot's or actuator's own, or 60 for a motor file.
        json: print JSON only.
    """

    source: tyro.conf.Positional[str] = "bp2"
    joint: tyro.conf.Positional[str] = "hip"
    bus_voltage: float | None = None
    json: bool = False

    def run(self) -> int:
        """Print the parameters; raises ``SprintlabError`` for an unknown source."""
        show(chosen_motor(**arguments(self), gear_ratio=1.0, gear_efficiency=1.0), self)
        return 0


Motor = group(
    "Motors: from a data sheet or a bench to parameters, envelope and picture.",
    {
        "envelope": command(envelope, positional=2, figure=FIGURE),
        "from-datasheet": MotorFromDatasheet,
        "identify": command(
            identify_motor,
            repeated="column",
            figure="picture (.png, .pdf or .svg) of fit and residuals; none when left out.",
            status=lambda found: 0 if found.trustworthy else UNTRUSTED,
        ),
        "library": MotorLibrary,
        "show": MotorShow,
    },
)
