"""``envelope``: what a joint's motor gives at which speed, under every motor model."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import RenderableType

from sprintlab.api.motors import ChosenMotor, chosen_motor
from sprintlab.api.tables import Drawn, in_notebook, plain_table, styled
from sprintlab.core.arguments import checked

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sprintlab.evaluation.operating_points import OperatingPoints

SHORT_NAMES = {"simplified-dc": "v_d = 0", "refined + saturation": "refined + sat."}


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Envelope(Drawn):
    """The torque-speed envelope of a joint under every motor model; rad/s and N m behind the gear."""

    motor: ChosenMotor
    """Motor, gear and bus voltage."""
    points: int
    """Speeds of the table, from standstill to the no-load speed."""
    operated: OperatingPoints | None = None
    """What a recorded run asked of the motor."""

    def to_dict(self) -> dict[str, Any]:
        """Everything about the envelope: speeds [rad/s], torques [N m], powers [W], on the joint's side."""
        from sprintlab.motors import MOTOR_MODELS, chart

        drive = self.motor.drive
        numbers = {
            "bus_voltage": drive.bus_voltage,
            "gear": asdict(drive.gear),
            "side": "joint",
            "no_load_speed": drive.no_load_speed,
            "critical_speed": {model: chart.peak_torque_speed(drive, model) for model in MOTOR_MODELS},
            "end_of_drive": {model: chart.end_of_drive(drive, model) for model in MOTOR_MODELS},
            "peak_power": {name: asdict(chart.peak_power(drive, name)) for name in chart.envelope_names()},
            "d_axis_cost": [
                {**asdict(cost), "lost": cost.lost}
                for cost in (chart.d_axis_cost(drive, share) for share in chart.D_AXIS_SHARES)
            ],
            "rows": self.rows(),
        }
        if self.operated is not None:
            numbers["operating_points"] = self.operated.summary(drive)
        return numbers

    def rows(self) -> list[dict[str, float]]:
        """The envelopes at evenly spaced speeds, one dictionary per speed.

        ``NAME upper`` bounds driving and ``NAME lower`` braking; negative speeds mirror both.
        """
        import numpy as np

        from sprintlab.motors import chart

        speed = np.linspace(0.0, self.motor.drive.no_load_speed, self.points)
        columns: dict[str, Any] = {"speed": speed}
        for name in chart.envelope_names():
            lower, upper = chart.joint_limits(self.motor.drive, speed, name)
            columns[f"{name} lower"], columns[f"{name} upper"] = lower, upper
        return [{name: float(values[i]) for name, values in columns.items()} for i in range(self.points)]

    def tables(self) -> Iterator[RenderableType]:
        """Limits by speed, the models' ends and powers, the cost of the d-axis, the recorded run."""
        numbers = self.to_dict()
        yield _limits_table(self.motor.title, numbers["rows"])
        yield styled("[dim]driving torque, braking torque below it; negative speeds mirror both[/]\n")
        yield _models_table(numbers)
        yield ""
        yield _cost_table(numbers["d_axis_cost"])
        if "operating_points" in numbers:
            yield ""
            yield _operating_table(numbers["operating_points"])
        yield "\nspeed in rad/s, torque in N m, power in W, all on the joint's side of the gear"

    def plot(self) -> Figure:
        """All four quadrants, with the recorded run's operating points."""
        from sprintlab.evaluation.motor_figures import workbench_figure

        return in_notebook(workbench_figure(self.motor.drive, self.motor.title, self.operated))


@checked
def envelope(
    source: str = "bp2",
    joint: str = "hip",
    *,
    bus_voltage: float | None = None,
    gear_ratio: float | None = None,
    gear_efficiency: float | None = None,
    trajectory: Path | None = None,
    points: int = 13,
) -> Envelope:
    """Print and draw the torque-speed envelope of a joint under every motor model, all four quadrants.

    Args:
        source: a motor file (TOML), the name of a robot, or an actuator of the library.
        joint: which motor of the robot: abad, hip, knee, or a full name such as RL_hip.
        bus_voltage: [V]; the robot's or actuator's own, or 60 for a motor file.
        gear_ratio: motor speed over joint speed; the robot's or actuator's own, or 1 for a motor file.
        gear_efficiency: the robot's or actuator's own, or 1 for a motor file.
        trajectory: trajectory.npz of a race, drawn over the envelope and compared with it.
        points: speeds in the table, from standstill to the no-load speed.

    Raises:
        SprintlabError: an unknown source or joint, a bad number, or the file is no trajectory of a race.
    """
    from sprintlab.core.checks import check_range

    check_range("points", points, 2, 10_000)
    chosen = chosen_motor(source, joint, bus_voltage, gear_ratio, gear_efficiency)
    operated = None if trajectory is None else operating_points(chosen, trajectory, joint)
    return Envelope(motor=chosen, points=points, operated=operated)


def operating_points(chosen: ChosenMotor, trajectory: Path, joint: str) -> OperatingPoints:
    """What a recorded run asked of the motor; for a motor alone ``joint`` names joints of the robot ``bp2``.

    Raises:
        SprintlabError: the file is no trajectory of a race.
    """
    from sprintlab.evaluation.operating_points import load_operating_points
    from sprintlab.robots import load_robot

    columns = chosen.joints or tuple(
        index for index, name in enumerate(load_robot("bp2").joint_names) if name.endswith(joint)
    )
    return load_operating_points(trajectory, columns)


def _limits_table(title: str, rows: list[dict[str, float]]) -> RenderableType:
    names = [name.removesuffix(" upper") for name in rows[0] if name.endswith(" upper")]
    headings = [SHORT_NAMES.get(name, name) for name in names]
    table = plain_table(title, "speed", "", *headings, numbers=("speed", *headings))
    for row in rows:
        table.add_row(_text(row["speed"]), "drive", *(_text(row[f"{name} upper"]) for name in names))
        table.add_row("", "brake", *(_text(row[f"{name} lower"]) for name in names), style="dim")
    return table


def _models_table(numbers: dict[str, Any]) -> RenderableType:
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


def _cost_table(costs: list[dict[str, float]]) -> RenderableType:
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


def _operating_table(summary: dict[str, float]) -> RenderableType:
    table = plain_table("Operating points of the trajectory", "quantity", "value")
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
