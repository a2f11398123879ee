"""``sprintlab motor library``: actuators with published parameters, compared or one by one."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tyro

from sprintlab.cli.motor_datasheet import PARAMETER_UNITS
from sprintlab.cli.output import plain_table, print_json, show_files, stdout_console, styled

if TYPE_CHECKING:
    from rich.table import Table

    from sprintlab.motors import LibraryMotor

_UNITS = {
    "bus_voltage": "V",
    **{f"motor.{name}": unit for name, unit in PARAMETER_UNITS.items()},
    "gear.ratio": "",
    "gear.efficiency": "",
}


@dataclass(frozen=True, kw_only=True)
class MotorLibrary:
    """Compare the actuators of the library, or print one with the source of every number.

    Attributes:
        name: one actuator; all of them when left out.
        figure: picture of all torque-speed envelopes, absolute and normalised (.png, .pdf or .svg).
        save: write the chosen actuator's motor as a motor file (TOML) for the other commands.
        json: print JSON only.
    """

    name: tyro.conf.Positional[str | None] = None
    figure: Path | None = None
    save: Path | None = None
    json: tyro.conf.FlagCreatePairsOff[bool] = False

    def run(self) -> int:
        """Print the library or one actuator; raises ``SprintlabError`` for an unknown name."""
        from sprintlab.core.errors import InvalidValueError
        from sprintlab.core.files import check_figure_path
        from sprintlab.motors import library_motors, load_library_motor, save_motor

        check_figure_path(self.figure)
        if self.save is not None and self.name is None:
            raise InvalidValueError("save", str(self.save), "name the actuator to save")
        names = library_motors() if self.name is None else (self.name,)
        actuators = [load_library_motor(name) for name in names]
        if self.save is not None:
            save_motor(actuators[0].motor, self.save)
        if self.figure is not None:
            _draw(self.figure, [load_library_motor(name) for name in library_motors()])
        if self.json:
            print_json([actuator_numbers(actuator) for actuator in actuators])
        else:
            self._print(actuators)
        return 0

    def _print(self, actuators: list[LibraryMotor]) -> None:
        console = stdout_console()
        if self.name is None:
            console.print(_comparison(actuators))
            console.print(
                "joint side, speeds in rad/s, torques in N m; corner: up to there the peak torque fits; "
                "lost: what v_d takes from the corner; estimated: numbers that nobody published"
            )
        else:
            console.print(_sources(actuators[0]))
        show_files(figure=self.figure, motor_file=self.save)


def actuator_numbers(actuator: LibraryMotor) -> dict[str, Any]:
    """An actuator as JSON: every number with its source, and what follows behind the gear."""
    return {
        "name": actuator.name,
        "title": actuator.title,
        "values": {
            key: {
                "value": item.value,
                "unit": _UNITS[key],
                "source": item.source,
                "estimated": item.estimated,
            }
            for key, item in actuator.values.items()
        },
        "joint": joint_numbers(actuator),
    }


def joint_numbers(actuator: LibraryMotor) -> dict[str, float]:
    """Peak torque after saturation [N m], no-load and corner speeds [rad/s] behind the gear."""
    from sprintlab.motors import critical_speed, joint_torque, no_load_speed, saturate

    motor, ratio, bus = actuator.motor, float(actuator.gear.ratio), actuator.bus_voltage
    refined, simplified = (
        float(critical_speed(motor, motor.peak_torque, bus, model)) / ratio
        for model in ("refined", "simplified-dc")
    )
    return {
        "peak_torque": float(joint_torque(actuator.gear, saturate(motor, motor.peak_torque))),
        "peak_current": float(motor.peak_torque / motor.torque_constant),
        "no_load_speed": float(no_load_speed(motor, bus)) / ratio,
        "corner_speed": refined,
        "corner_speed_v_d_0": simplified,
        "corner_lost_to_v_d": 1.0 - refined / simplified if simplified > 0.0 else 0.0,
        "reflected_inertia": float(motor.rotor_inertia) * ratio**2,
    }


def _comparison(actuators: list[LibraryMotor]) -> Table:
    columns = ("name", "bus", "gear", "peak torque", "peak current", "no load", "corner", "v_d = 0", "lost")
    table = plain_table("Actuators", *columns, "estimated", numbers=(*columns[1:], "estimated"))
    for actuator in actuators:
        joint = joint_numbers(actuator)
        keys = ("peak_torque", "peak_current", "no_load_speed", "corner_speed", "corner_speed_v_d_0")
        table.add_row(
            actuator.name,
            f"{actuator.bus_voltage:g} V",
            f"{actuator.gear.ratio:g}",
            *(f"{joint[key]:.1f}" for key in keys),
            f"{100 * joint['corner_lost_to_v_d']:.0f} %",
            str(len(actuator.estimated)),
        )
    return table


def _sources(actuator: LibraryMotor) -> Table:
    table = plain_table(actuator.title, "quantity", "value", "unit", "", "source", numbers=("value",))
    table.columns[-1].overflow = "fold"
    for name, item in actuator.values.items():
        mark = styled("[yellow]estimated[/]") if item.estimated else ""
        table.add_row(name, f"{item.value:.5g}", _UNITS[name], mark, item.source)
    return table


def _draw(path: Path, actuators: list[LibraryMotor]) -> None:
    from sprintlab.core.theme import save_figure
    from sprintlab.evaluation.library_figures import library_figure

    save_figure(path, library_figure(actuators))
