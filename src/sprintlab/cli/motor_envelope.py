"""``sprintlab motor envelope``: a joint's torque-speed envelope under every model, numbers and picture."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tyro

from sprintlab.api.motors import ChosenMotor, chosen_motor, envelope_numbers, operating_points
from sprintlab.cli.output import plain_table, print_json, show_files, stdout_console, styled

if TYPE_CHECKING:
    from rich.table import Table

    from sprintlab.evaluation.operating_points import OperatingPoints

SHORT_NAMES = {"simplified-dc": "v_d = 0", "refined + saturation": "refined + sat."}


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
        from sprintlab.core.checks import check_range
        from sprintlab.core.files import check_figure_path

        check_figure_path(self.figure)
        check_range("points", self.points, 2, 10_000)
        chosen = chosen_motor(
            self.source, self.joint, self.bus_voltage, self.gear_ratio, self.gear_efficiency
        )
        operated = None if self.trajectory is None else operating_points(chosen, self.trajectory, self.joint)
        if self.figure is not None:
            _draw(self.figure, chosen, operated)
        numbers = envelope_numbers(chosen.drive, self.points)
        if operated is not None:
            numbers["operating_points"] = operated.summary(chosen.drive)
        if self.json:
            print_json(numbers)
        else:
            _print(chosen.title, numbers, self.figure)
        return 0


def _draw(path: Path, chosen: ChosenMotor, operated: OperatingPoints | None) -> None:
    from sprintlab.core.theme import save_figure
    from sprintlab.evaluation.motor_figures import workbench_figure

    save_figure(path, workbench_figure(chosen.drive, chosen.title, operated))


def _print(title: str, numbers: dict[str, Any], figure: Path | None) -> None:
    console = stdout_console()
    console.print(_limits_table(title, numbers["rows"]))
    console.print(styled("[dim]driving torque, braking torque below it; negative speeds mirror both[/]\n"))
    console.print(_models_table(numbers))
    console.print()
    console.print(_cost_table(numbers["d_axis_cost"]))
    if "operating_points" in numbers:
        console.print()
        console.print(_operating_table(numbers["operating_points"]))
    console.print("\nspeed in rad/s, torque in N m, power in W, all on the joint's side of the gear")
    show_files(figure=figure)


def _limits_table(title: str, rows: list[dict[str, float]]) -> Table:
    names = [name.removesuffix(" upper") for name in rows[0] if name.endswith(" upper")]
    headings = [SHORT_NAMES.get(name, name) for name in names]
    table = plain_table(title, "speed", "", *headings, numbers=("speed", *headings))
    for row in rows:
        table.add_row(_text(row["speed"]), "drive", *(_text(row[f"{name} upper"]) for name in names))
        table.add_row("", "brake", *(_text(row[f"{name} lower"]) for name in names), style="dim")
    return table


def _models_table(numbers: dict[str, Any]) -> Table:
    columns = ("whole peak torque up to", "drives up to", "most power", "at speed", "with torque")
    table = plain_table("Speeds and power", "model", *columns, numbers=columns)
    for name, power in numbers["peak_power"].items():
        ends = [_text(numbers[key].get(name)) for key in ("critical_speed", "end_of_drive")]
        if name not in numbers["critical_speed"]:
            ends = [_text(numbers[key]["refined"]) for key in ("critical_speed", "end_of_drive")]
        values = (f"{power['power']:.0f}", _text(power["speed"]), _text(power["torque"]))
        table.add_row(SHORT_NAMES.get(name, name), *ends, *values)
    table.add_row("no-load speed", "", _text(numbers["no_load_speed"]))
    return table


def _cost_table(costs: list[dict[str, float]]) -> Table:
    columns = ("speed", "v_d = 0", "refined", "lost", "|v_d| / V")
    table = plain_table(
        "What the d-axis voltage costs", "share of the no-load speed", *columns, numbers=columns
    )
    for cost in costs:
        table.add_row(
            f"{cost['share']:.0%}",
            *(_text(cost[key]) for key in ("speed", "torque_without", "torque")),
            f"{cost['lost']:.1%}",
            f"{cost['voltage_share']:.2f}",
        )
    return table


def _operating_table(summary: dict[str, float]) -> Table:
    table = plain_table("Operating points of the trajectory", "quantity", "value", numbers=("value",))
    table.add_row("samples", f"{summary['samples']:.0f}")
    table.add_row("highest speed over no-load speed", f"{summary['speed_ratio']:.3f}")
    table.add_row("greatest torque over the peak torque", f"{summary['torque_ratio']:.3f}")
    table.add_row("share on the envelope, refined + sat.", f"{summary['at_limit']:.2%}")
    for name, share in summary["beyond"].items():  # pyright: ignore[reportAttributeAccessIssue]
        table.add_row(f"share beyond {SHORT_NAMES.get(name, name)}", f"{share:.2%}")
    return table


def _text(value: float | None) -> str:
    """Two decimals, three below 10; no negative zero."""
    if value is None:
        return "no limit"
    return f"{round(value, 3) + 0.0:.{2 if abs(value) >= 10 else 3}f}"
