"""``sprintlab motor``: from a data sheet or a bench to a motor, and what it can give at which speed."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Annotated

import tyro

from sprintlab.api.motors import chosen_motor
from sprintlab.cli.motor_datasheet import PARAMETER_UNITS, MotorFromDatasheet
from sprintlab.cli.motor_envelope import MotorEnvelope
from sprintlab.cli.motor_identify import MotorIdentify
from sprintlab.cli.motor_library import MotorLibrary
from sprintlab.cli.output import plain_table, print_json, stdout_console


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
        chosen = chosen_motor(self.source, self.joint, self.bus_voltage, gear_ratio=1.0, gear_efficiency=1.0)
        drive = chosen.drive
        speeds = _characteristic_speeds(drive)
        parameters = {item.name: float(getattr(drive.motor, item.name)) for item in fields(drive.motor)}
        if self.json:
            print_json({"motor": parameters, "bus_voltage": drive.bus_voltage, **speeds})
            return 0
        table = plain_table(chosen.title, "quantity", "value", "unit", numbers=("value",))
        for name, value in parameters.items():
            table.add_row(name, f"{value:.5g}", PARAMETER_UNITS.get(name, ""))
        for name, value in speeds.items():
            table.add_row(name, f"{value:.5g}", "rad/s")
        stdout_console().print(table)
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


def _characteristic_speeds(drive: object) -> dict[str, float]:
    """No-load speed, and the speeds up to which the peak torque fits [rad/s]."""
    from sprintlab.motors.chart import JointDrive, peak_torque_speed

    assert isinstance(drive, JointDrive)
    return {
        "no_load_speed": drive.no_load_speed,
        "critical_speed_refined": peak_torque_speed(drive, "refined") or 0.0,
        "critical_speed_v_d_0": peak_torque_speed(drive, "simplified-dc") or 0.0,
    }
