"""``sprintlab motor``: from a data sheet or a bench to a motor, and what it can give at which speed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import tyro

from sprintlab.api.motors import chosen_motor
from sprintlab.cli.motor_datasheet import MotorFromDatasheet
from sprintlab.cli.motor_envelope import MotorEnvelope
from sprintlab.cli.motor_identify import MotorIdentify
from sprintlab.cli.motor_library import MotorLibrary
from sprintlab.cli.output import arguments, show


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
    json: tyro.conf.FlagCreatePairsOff[bool] = False

    def run(self) -> int:
        """Print the parameters; raises ``SprintlabError`` for an unknown source."""
        show(chosen_motor(**arguments(self), gear_ratio=1.0, gear_efficiency=1.0), self)
        return 0


@dataclass(frozen=True, kw_only=True)
class Motor:
    """Motors: from a data sheet or a bench to parameters, envelope and picture."""

    command: (
        Annotated[MotorEnvelope, tyro.conf.subcommand(name="envelope")]
        | Annotated[MotorFromDatasheet, tyro.conf.subcommand(name="from-datasheet")]
        | Annotated[MotorIdentify, tyro.conf.subcommand(name="identify")]
        | Annotated[MotorLibrary, tyro.conf.subcommand(name="library")]
        | Annotated[MotorShow, tyro.conf.subcommand(name="show")]
    )

    def run(self) -> int:
        """Run the chosen subcommand."""
        return self.command.run()
