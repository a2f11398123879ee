"""A motor by its name: a file, a joint of a robot, or one of the library; and its envelope in numbers."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sprintlab.core.errors import InvalidValueError

if TYPE_CHECKING:
    from sprintlab.evaluation.operating_points import OperatingPoints

DEFAULT_BUS_VOLTAGE = 60.0


@dataclass(frozen=True, kw_only=True)
class ChosenMotor:
    """A motor with what surrounds it.

    Attributes:
        drive: ``JointDrive`` of plain numbers.
        title: for tables and figures.
        joints: columns of a trajectory that this motor drives; empty for a motor file.
    """

    drive: Any
    title: str
    joints: tuple[int, ...]


def chosen_motor(
    source: str,
    joint: str,
    bus_voltage: float | None,
    gear_ratio: float | None = None,
    gear_efficiency: float | None = None,
) -> ChosenMotor:
    """The motor that the command line names; what it leaves out comes from the robot or the library.

    Raises:
        SprintlabError: no such robot or file; ``InvalidValueError``: no such joint, a bad voltage or gear.
    """
    from sprintlab.core.checks import check_positive
    from sprintlab.motors import library_motors
    from sprintlab.motors.chart import JointDrive

    if bus_voltage is not None:
        check_positive("bus_voltage", bus_voltage, "V")
    if source.endswith(".toml"):
        motor, gear, voltage, name, joints = _from_file(source)
    elif source in library_motors():
        motor, gear, voltage, name, joints = _from_library(source)
    else:
        motor, gear, voltage, name, joints = _from_robot(source, joint)
    voltage = bus_voltage or voltage
    gear = _replaced_gear(gear, gear_ratio, gear_efficiency)
    geared = f", gear {gear.ratio:g}" if gear.ratio != 1.0 else ""
    return ChosenMotor(
        drive=JointDrive(motor=motor, gear=gear, bus_voltage=voltage),
        title=f"{name} at {voltage:g} V{geared}",
        joints=joints,
    )


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


def envelope_numbers(drive: Any, points: int) -> dict[str, Any]:
    """Everything about a joint's envelope, ready for JSON: speeds in rad/s and torques in N m, joint side."""
    from sprintlab.motors import MOTOR_MODELS, chart

    return {
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
        "rows": envelope_rows(drive, points),
    }


def envelope_rows(drive: Any, points: int) -> list[dict[str, float]]:
    """The envelopes at evenly spaced speeds from 0 to the no-load speed, one dictionary a speed.

    ``NAME upper`` bounds driving and ``NAME lower`` braking; at negative speed they trade places and signs.
    """
    import numpy as np

    from sprintlab.motors import chart

    speed = np.linspace(0.0, drive.no_load_speed, points)
    columns: dict[str, Any] = {"speed": speed}
    for name in chart.envelope_names():
        columns[f"{name} lower"], columns[f"{name} upper"] = chart.joint_limits(drive, speed, name)
    return [{name: float(values[i]) for name, values in columns.items()} for i in range(points)]


def _from_file(source: str) -> tuple[Any, Any, float, str, tuple[int, ...]]:
    from sprintlab.motors import Gear, load_motor

    motor = load_motor(source)
    if any(getattr(getattr(motor, item.name), "size", 1) > 1 for item in fields(motor)):
        raise InvalidValueError(source, "several motors", "must hold one motor, one number a field")
    return _single(motor, 0), Gear(ratio=1.0, efficiency=1.0), DEFAULT_BUS_VOLTAGE, Path(source).stem, ()


def _from_library(source: str) -> tuple[Any, Any, float, str, tuple[int, ...]]:
    from sprintlab.motors import load_library_motor

    actuator = load_library_motor(source)
    return actuator.motor, actuator.gear, actuator.bus_voltage, source, ()


def _from_robot(source: str, joint: str) -> tuple[Any, Any, float, str, tuple[int, ...]]:
    from sprintlab.motors import library_motors
    from sprintlab.robots import joint_kind, load_robot, robot_names

    if source not in robot_names() and not {"/", "\\"} & set(source):
        known = f"a robot ({', '.join(robot_names())}) or an actuator ({', '.join(library_motors())})"
        raise InvalidValueError("source", source, f"choose a motor file (.toml), {known}")
    robot = load_robot(source)
    chosen = [index for index, name in enumerate(robot.joint_names) if joint in (name, joint_kind(name))]
    if not chosen:
        kinds = dict.fromkeys(map(joint_kind, robot.joint_names))
        raise InvalidValueError("joint", joint, "choose one of " + ", ".join([*kinds, *robot.joint_names]))
    first = chosen[0]
    motor, gear = _single(robot.motors, first), _single(robot.gear, first)
    return motor, gear, float(robot.bus_voltage), f"{source} {joint} motor", tuple(chosen)


def _single(table: Any, index: int) -> Any:
    """The element at ``index`` of a dataclass of arrays, with one plain number a field."""
    import numpy as np

    columns = {item.name: np.atleast_1d(getattr(table, item.name)) for item in fields(table)}
    return type(table)(
        **{name: float(column[min(index, len(column) - 1)]) for name, column in columns.items()}
    )


def _replaced_gear(gear: Any, ratio: float | None, efficiency: float | None) -> Any:
    from sprintlab.motors import Gear

    return Gear(
        ratio=gear.ratio if ratio is None else ratio,
        efficiency=gear.efficiency if efficiency is None else efficiency,
    )
