"""``sprintlab motor``: what a motor can give at which speed."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any

import tyro

from sprintlab.cli.output import plain_table, print_json, stdout_console
from sprintlab.core.errors import InvalidValueError

DEFAULT_BUS_VOLTAGE = 60.0
UNITS = {
    "pole_pairs": "",
    "stator_resistance": "ohm",
    "q_axis_inductance": "H",
    "flux_linkage": "Wb",
    "peak_torque": "N m",
    "saturation": "",
    "rotor_inertia": "kg m^2",
}


@dataclass(frozen=True, kw_only=True)
class MotorShow:
    """Print a motor's parameters and the speeds that follow from them.

    Attributes:
        source: a motor file (TOML) or the name of a robot.
        joint: which motor of the robot: abad, hip, knee, or a full name such as RL_hip.
        bus_voltage: [V]; the robot's own, or 60 for a motor file.
        json: print JSON only.
    """

    source: tyro.conf.Positional[str] = "bp2"
    joint: tyro.conf.Positional[str] = "hip"
    bus_voltage: float | None = None
    json: tyro.conf.FlagCreatePairsOff[bool] = False

    def run(self) -> int:
        """Print the parameters; raises ``SprintlabError`` for an unknown source."""
        motor, voltage, title = chosen_motor(self.source, self.joint, self.bus_voltage)
        speeds = characteristic_speeds(motor, voltage)
        parameters = {item.name: float(getattr(motor, item.name)) for item in fields(motor)}
        if self.json:
            print_json({"motor": parameters, "bus_voltage": voltage, **speeds})
            return 0
        table = plain_table(title, "quantity", "value", "unit", numbers=("value",))
        for name, value in parameters.items():
            table.add_row(name, f"{value:.5g}", UNITS[name])
        for name, value in speeds.items():
            table.add_row(name, f"{value:.5g}", "rad/s")
        stdout_console().print(table)
        return 0


@dataclass(frozen=True, kw_only=True)
class MotorEnvelope:
    """Print and draw a motor's torque-speed envelope, motor side.

    Attributes:
        source: a motor file (TOML) or the name of a robot.
        joint: which motor of the robot: abad, hip, knee, or a full name such as RL_hip.
        bus_voltage: [V]; the robot's own, or 60 for a motor file.
        figure: PNG to draw; none when left out.
        points: speeds in the table, from standstill to the no-load speed.
        json: print JSON only.
    """

    source: tyro.conf.Positional[str] = "bp2"
    joint: tyro.conf.Positional[str] = "hip"
    bus_voltage: float | None = None
    figure: Path | None = None
    points: int = 13
    json: tyro.conf.FlagCreatePairsOff[bool] = False

    def run(self) -> int:
        """Print the envelope; raises ``SprintlabError`` for an unknown source or a bad field."""
        from sprintlab.core.checks import check_range

        check_range("points", self.points, 2, 10_000)
        motor, voltage, title = chosen_motor(self.source, self.joint, self.bus_voltage)
        rows = envelope_rows(motor, voltage, self.points)
        if self.figure is not None:
            self._draw(motor, voltage, title)
        if self.json:
            print_json({"bus_voltage": voltage, **characteristic_speeds(motor, voltage), "rows": rows})
        else:
            self._print(rows, title)
        return 0

    def _draw(self, motor: Any, voltage: float, title: str) -> None:
        from sprintlab.core.files import atomic_write_bytes
        from sprintlab.evaluation.figures import envelope_figure, png_bytes

        assert self.figure is not None
        atomic_write_bytes(self.figure, png_bytes(envelope_figure(motor, voltage, title)))

    def _print(self, rows: list[dict[str, float]], title: str) -> None:
        columns = tuple(rows[0])
        table = plain_table(title, *columns, numbers=columns)
        for row in rows:
            table.add_row(*(f"{value:.2f}" for value in row.values()))
        console = stdout_console()
        console.print(table)
        console.print("speed in rad/s, torque in N m before saturation, all on the motor's side of the gear")
        if self.figure is not None:
            console.print(f"figure: {self.figure}")


@dataclass(frozen=True, kw_only=True)
class Motor:
    """Motors: parameters and torque-speed envelope."""

    command: (
        Annotated[MotorEnvelope, tyro.conf.subcommand(name="envelope")]
        | Annotated[MotorShow, tyro.conf.subcommand(name="show")]
    )

    def run(self) -> int:
        """Run the chosen subcommand."""
        return self.command.run()


def chosen_motor(source: str, joint: str, bus_voltage: float | None) -> tuple[Any, float, str]:
    """One motor, its bus voltage and a title.

    Raises:
        SprintlabError: no such robot or file; ``InvalidValueError``: no such joint, or a bad voltage.
    """
    from sprintlab.core.checks import check_positive
    from sprintlab.motors import load_motor
    from sprintlab.robots import load_robot

    if bus_voltage is not None:
        check_positive("bus_voltage", bus_voltage, "V")
    if source.endswith(".toml"):
        voltage = bus_voltage or DEFAULT_BUS_VOLTAGE
        return _single(load_motor(source), 0, source), voltage, f"{source} at {voltage:g} V"
    robot = load_robot(source)
    voltage = bus_voltage or float(robot.bus_voltage)
    names = [name for name in robot.joint_names if joint in (name, name.split("_", 1)[1])]
    if not names:
        kinds = dict.fromkeys(name.split("_", 1)[1] for name in robot.joint_names)
        raise InvalidValueError("joint", joint, "choose one of " + ", ".join([*kinds, *robot.joint_names]))
    motor = _single(robot.motors, robot.joint_names.index(names[0]), source)
    return motor, voltage, f"{source} {joint} motor at {voltage:g} V"


def _single(motor: Any, index: int, source: str) -> Any:
    """The motor at ``index`` with one plain number a field."""
    import numpy as np

    from sprintlab.motors import PmsmParameters

    columns = {item.name: np.atleast_1d(getattr(motor, item.name)) for item in fields(motor)}
    if source.endswith(".toml") and any(len(column) > 1 for column in columns.values()):
        raise InvalidValueError(source, "several motors", "must hold one motor, one number a field")
    return PmsmParameters(
        **{name: float(column[min(index, len(column) - 1)]) for name, column in columns.items()}
    )


def characteristic_speeds(motor: Any, bus_voltage: float) -> dict[str, float]:
    """No-load speed, and the speeds up to which the peak torque fits [rad/s], motor side."""
    from sprintlab.motors import critical_speed, no_load_speed

    return {
        "no_load_speed": float(no_load_speed(motor, bus_voltage)),
        "critical_speed_refined": float(critical_speed(motor, motor.peak_torque, bus_voltage)),
        "critical_speed_v_d_0": float(
            critical_speed(motor, motor.peak_torque, bus_voltage, model="simplified-dc")
        ),
    }


def envelope_rows(motor: Any, bus_voltage: float, points: int) -> list[dict[str, float]]:
    """The envelope at evenly spaced speeds from 0 to the no-load speed, one dictionary a speed."""
    import numpy as np

    from sprintlab.motors import MOTOR_MODELS, no_load_speed, torque_limits

    speed = np.linspace(0.0, float(no_load_speed(motor, bus_voltage)), points)
    columns: dict[str, Any] = {"speed": speed}
    for model in MOTOR_MODELS:
        name = "v_d = 0" if model == "simplified-dc" else model
        lower, upper = torque_limits(motor, speed, bus_voltage, model=model)
        columns[f"{name} upper"] = np.asarray(upper)
        if model == "refined":
            columns["refined lower"] = np.asarray(lower)
    return [{name: float(values[i]) for name, values in columns.items()} for i in range(points)]
