"""A motor by its name: a file, a joint of a robot, or one of the library."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import RenderableType
from rich.table import Table

from sprintlab.api.tables import Printed, plain_table
from sprintlab.core.arguments import checked
from sprintlab.core.errors import InvalidValueError, SprintlabError

if TYPE_CHECKING:
    from sprintlab.motors import Gear, PmsmParameters
    from sprintlab.motors.chart import JointDrive


def motor_table(title: str, heading: str, motor: Mapping[str, float], speeds: Mapping[str, float]) -> Table:
    """A motor's parameters and speeds [rad/s] by name, one a row, with their units."""
    from sprintlab.motors.parameters import MOTOR_UNITS

    units = MOTOR_UNITS | dict.fromkeys(speeds, "rad/s")
    rows = ((name, f"{value:.5g}", units[name]) for name, value in {**motor, **speeds}.items())
    return plain_table(title, heading, "value", "unit", rows=rows)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ChosenMotor(Printed):
    """A motor with its gear and bus voltage; prints its parameters and the speeds that follow from them."""

    drive: JointDrive
    """Motor, gear and bus voltage as plain numbers."""
    title: str
    """For tables and figures."""
    joints: tuple[int, ...]
    """Columns of a trajectory that this motor drives; empty for a motor file."""

    def parameters(self) -> dict[str, float]:
        """The numbers of the motor's file, in the units of ``motors.parameters.MOTOR_UNITS``."""
        motor = self.drive.motor
        return {item.name: float(getattr(motor, item.name)) for item in fields(motor)}

    def speeds(self) -> dict[str, float]:
        """No-load speed, and the speeds up to which the peak torque fits, behind the gear [rad/s]."""
        from sprintlab.motors.chart import peak_torque_speed

        return {
            "no_load_speed": self.drive.no_load_speed,
            "critical_speed_refined": peak_torque_speed(self.drive, "refined") or 0.0,
            "critical_speed_v_d_0": peak_torque_speed(self.drive, "simplified-dc") or 0.0,
        }

    def to_dict(self) -> dict[str, Any]:
        """Parameters, constants [N m/A, rpm/V], bus voltage [V] and speeds [rad/s]."""
        return {
            "motor": self.parameters(),
            "torque_constant": float(self.drive.motor.torque_constant),
            "kv": float(self.drive.motor.speed_constant) * 60.0 / (2.0 * math.pi),
            "bus_voltage": self.drive.bus_voltage,
            **self.speeds(),
        }

    def tables(self) -> Iterator[RenderableType]:
        """Parameters and speeds, then the constants that data sheets print, with their convention."""
        numbers = self.to_dict()
        yield motor_table(self.title, "quantity", self.parameters(), self.speeds())
        yield (
            f"torque constant {numbers['torque_constant']:.4g} N m/A, per ampere of phase amplitude; "
            f"KV {numbers['kv']:.4g} rpm/V, per volt of the line-to-line amplitude"
        )


@checked
def chosen_motor(
    source: str = "bp2",
    joint: str = "hip",
    bus_voltage: float | None = None,
    gear_ratio: float | None = None,
    gear_efficiency: float | None = None,
) -> ChosenMotor:
    """A motor by its name; what is left out comes from the robot or the library.

    Args:
        source: a motor file or a data sheet (TOML), the name of a robot, or an actuator of the library.
        joint: which motor of the robot: abad, hip, knee, or a full name such as RL_hip.
        bus_voltage: [V]; the robot's or the library's when left out, needed for a file, which has none.
        gear_ratio: motor speed over joint speed; 1 for a motor file when left out.
        gear_efficiency: likewise.

    Raises:
        SprintlabError: no such robot or file; ``InvalidValueError``: no such joint, a bad voltage or gear.
    """
    from sprintlab.motors import library_motors
    from sprintlab.motors.chart import JointDrive
    from sprintlab.motors.voltage import check_bus_voltage

    if bus_voltage is not None:
        check_bus_voltage(bus_voltage)
    if source.endswith(".toml"):
        motor, gear, name, joints = *file_motor(source), Path(source).stem, ()
        if bus_voltage is None:
            raise SprintlabError(f"bus_voltage is not given: {source} describes a motor without its bus")
        voltage = bus_voltage
    elif source in library_motors():
        motor, gear, voltage, name, joints = _from_library(source)
    else:
        motor, gear, voltage, name, joints = _from_robot(source, joint)
    voltage = bus_voltage or voltage
    given = {"ratio": gear_ratio, "efficiency": gear_efficiency}
    gear = replace(gear, **{name: value for name, value in given.items() if value is not None})
    geared = f", gear {gear.ratio:g}" if gear.ratio != 1.0 else ""
    return ChosenMotor(
        drive=JointDrive(motor=motor, gear=gear, bus_voltage=voltage),
        title=f"{name} at {voltage:g} V{geared}",
        joints=joints,
    )


def file_motor(source: str) -> tuple[PmsmParameters, Gear]:
    """The motor of a motor file or a data sheet, with the gear that the sheet names (1 where it names none).

    Raises:
        SprintlabError: the file cannot be read or is neither; ``InvalidValueError``: it holds several motors.
    """
    from sprintlab.core.reading import read_toml
    from sprintlab.motors import Gear, load_motor, single
    from sprintlab.workbench.datasheet import convert_datasheet
    from sprintlab.workbench.datasheet_file import load_datasheet

    if "datasheet" in read_toml(source, what="motor file"):
        sheet = load_datasheet(source)
        return convert_datasheet(sheet).motor, Gear(ratio=sheet.gear_ratio or 1.0, efficiency=1.0)
    motor = load_motor(source)
    if any(getattr(getattr(motor, item.name), "size", 1) > 1 for item in fields(motor)):
        raise InvalidValueError(source, "several motors", "must hold one motor, one number a field")
    return single(motor), Gear(ratio=1.0, efficiency=1.0)


def _from_library(source: str) -> tuple[Any, Any, float, str, tuple[int, ...]]:
    from sprintlab.motors import load_library_motor

    actuator = load_library_motor(source)
    return actuator.motor, actuator.gear, actuator.bus_voltage, source, ()


def _from_robot(source: str, joint: str) -> tuple[Any, Any, float, str, tuple[int, ...]]:
    from sprintlab.motors import library_motors, single
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
    motor, gear = single(robot.motors, first), single(robot.gear, first)
    return motor, gear, float(robot.bus_voltage), f"{source} {joint} motor", tuple(chosen)
