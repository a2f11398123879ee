"""Motors: by name, from a data sheet, from a bench; and what they give at which speed."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.console import RenderableType
from rich.table import Table

from sprintlab import motors
from sprintlab.api.results import Drawn, Result, cell, drawn, kept, records, table
from sprintlab.core.arguments import checked
from sprintlab.core.checks import check_range
from sprintlab.core.errors import InvalidValueError, SprintlabError
from sprintlab.core.files import check_writable_file
from sprintlab.core.reading import read_toml
from sprintlab.motors import Gear, LibraryMotor, PmsmParameters, chart, library_motors, load_library_motor
from sprintlab.motors.chart import JointDrive
from sprintlab.motors.parameters import MOTOR_UNITS
from sprintlab.motors.voltage import check_bus_voltage
from sprintlab.robots import joint_kind, load_robot, robot_names
from sprintlab.workbench import datasheet, identification
from sprintlab.workbench.datasheet_file import datasheet_template, load_datasheet

SHORT_NAMES = {"simplified-dc": "v_d = 0", "refined + saturation": "refined + sat."}


class ChosenMotor(NamedTuple):
    """A motor with its gear and bus voltage, as plain numbers."""

    drive: JointDrive
    title: str


def chosen_motor(
    source: str,
    joint: str,
    bus_voltage: float | None = None,
    gear_ratio: float | None = None,
    gear_efficiency: float | None = None,
) -> ChosenMotor:
    """The motor that a file, an actuator's name or a robot's name and joint mean."""
    if bus_voltage is not None:
        check_bus_voltage(bus_voltage)
    if source.endswith(".toml"):
        (motor, gear), name = file_motor(source), Path(source).stem
        if (own := bus_voltage) is None:
            raise SprintlabError(f"bus_voltage is not given, and {source} describes a motor without a bus")
    elif source in library_motors():
        actuator = load_library_motor(source)
        motor, gear, own, name = actuator.motor, actuator.gear, actuator.bus_voltage, source
    else:
        if source not in robot_names() and not {"/", "\\"} & set(source):
            known = f"a robot ({', '.join(robot_names())}) or an actuator ({', '.join(library_motors())})"
            raise InvalidValueError("source", source, f"choose a motor file (.toml), {known}")
        robot = load_robot(source)
        kinds = dict.fromkeys(map(joint_kind, robot.joint_names))
        joints = [at for at, name in enumerate(robot.joint_names) if joint in (name, joint_kind(name))]
        if not joints:
            raise InvalidValueError(
                "joint", joint, f"choose one of {', '.join([*kinds, *robot.joint_names])}"
            )
        motor, gear = motors.single(robot.motors, joints[0]), motors.single(robot.gear, joints[0])
        own, name = float(robot.bus_voltage), f"{source} {joint} motor"
    given = {"ratio": gear_ratio, "efficiency": gear_efficiency}
    gear = replace(gear, **{name: value for name, value in given.items() if value is not None})
    drive = JointDrive(motor=motor, gear=gear, bus_voltage=bus_voltage or own)
    title = f"{name} at {drive.bus_voltage:g} V" + (f", gear {gear.ratio:g}" if gear.ratio != 1.0 else "")
    return ChosenMotor(drive, title)


def file_motor(source: str) -> tuple[PmsmParameters, Gear]:
    """The motor of a motor file or a data sheet, with the sheet's gear, or ratio 1."""
    if "datasheet" in read_toml(source, what="motor file"):
        sheet = load_datasheet(source)
        return datasheet.convert_datasheet(sheet).motor, Gear(ratio=sheet.gear_ratio or 1.0, efficiency=1.0)
    motor = motors.load_motor(source)
    if any(getattr(getattr(motor, item.name), "size", 1) > 1 for item in fields(motor)):
        raise InvalidValueError(source, "several motors", "must hold one motor, one number per field")
    return motors.single(motor), Gear(ratio=1.0, efficiency=1.0)


@checked
def show_motor(
    source: str = "bp2",
    joint: str = "hip",
    *,
    bus_voltage: float | None = None,
    gear_ratio: float | None = 1.0,
    gear_efficiency: float | None = 1.0,
) -> Result:
    """Print a motor's parameters and the speeds that follow from them, motor side where no gear is given.

    Example: sprintlab motor show bp2 hip

    Args:
        gear_ratio: motor speed over joint speed.
        gear_efficiency: efficiency of the gear.
    """
    drive, title = found = chosen_motor(source, joint, bus_voltage, gear_ratio, gear_efficiency)
    motor = {item.name: float(getattr(drive.motor, item.name)) for item in fields(drive.motor)}
    speeds = {
        "no_load_speed": drive.no_load_speed,
        "critical_speed_refined": chart.peak_torque_speed(drive, "refined") or 0.0,
        "critical_speed_v_d_0": chart.peak_torque_speed(drive, "simplified-dc") or 0.0,
    }
    constant = float(drive.motor.torque_constant)
    kv = float(drive.motor.speed_constant) * 60.0 / (2.0 * math.pi)
    numbers = {
        "motor": motor, "torque_constant": constant, "kv": kv, "bus_voltage": drive.bus_voltage, **speeds
    }  # fmt: skip
    note = (
        f"torque constant {constant:.4g} N m/A, per ampere of phase amplitude; "
        f"KV {kv:.4g} rpm/V, per volt of the line-to-line amplitude"
    )
    return Result(numbers=numbers, shown=[_motor_table(title, {**motor, **speeds}), note], found=found)


def _motor_table(title: str, values: Mapping[str, float]) -> Table:
    """A motor's parameters and speeds [rad/s] by name, one a row, with their units."""
    rows = ((name, cell(value), MOTOR_UNITS.get(name, "rad/s")) for name, value in values.items())
    return table(title, "quantity", "value", "unit", rows=rows)


@checked
def envelope(
    source: str = "bp2",
    joint: str = "hip",
    *,
    bus_voltage: float | None = None,
    gear_ratio: float | None = None,
    gear_efficiency: float | None = None,
    points: int = 13,
) -> Drawn:
    """Print and draw the torque-speed envelope of a joint under every motor model, all four quadrants.

    Example: sprintlab motor envelope bp2 hip --figure envelope.png

    Args:
        points: speeds in the table, from standstill to the no-load speed.
    """
    check_range("points", points, 2, 10_000)
    chosen = chosen_motor(source, joint, bus_voltage, gear_ratio, gear_efficiency)
    numbers = _envelope_numbers(chosen.drive, points)
    draw = drawn("evaluation.motor_figures.workbench_figure", chosen.drive, chosen.title)
    return Drawn(numbers=numbers, shown=list(_envelope_shown(chosen.title, numbers)), found=chosen, draw=draw)


def _envelope_numbers(drive: JointDrive, points: int) -> dict[str, Any]:
    """Speeds [rad/s], torques [N m] and powers [W] behind the gear.

    ``NAME upper`` bounds driving and ``NAME lower`` braking; negative speeds mirror both.
    """
    columns = {"speed": np.linspace(0.0, drive.no_load_speed, points)}
    for name in chart.envelope_names():
        limits = chart.joint_limits(drive, columns["speed"], name)
        columns |= {f"{name} {side}": limit for side, limit in zip(("lower", "upper"), limits, strict=True)}
    return {
        "bus_voltage": drive.bus_voltage,
        "gear": asdict(drive.gear),
        "side": "joint",
        "no_load_speed": drive.no_load_speed,
        "critical_speed": {model: chart.peak_torque_speed(drive, model) for model in motors.MOTOR_MODELS},
        "end_of_drive": {model: chart.end_of_drive(drive, model) for model in motors.MOTOR_MODELS},
        "peak_power": {name: chart.peak_power(drive, name) for name in chart.envelope_names()},
        "d_axis_cost": [chart.d_axis_cost(drive, share) for share in chart.D_AXIS_SHARES],
        "rows": [{name: float(values[i]) for name, values in columns.items()} for i in range(points)],
    }


def _envelope_shown(title: str, numbers: dict[str, Any]) -> Iterator[RenderableType]:
    """Limits by speed, the models' ends and powers, the cost of the d-axis."""
    names = {name: SHORT_NAMES.get(name, name) for name in chart.envelope_names()}
    limits = [
        {"speed": row["speed"]}
        | {names[name]: f"{cell(row[f'{name} upper'])} / {cell(row[f'{name} lower'])}" for name in names}
        for row in numbers["rows"]
    ]
    ends = {"whole peak torque up to": "critical_speed", "drives up to": "end_of_drive"}
    models = [
        {"model": names[name]}
        | {head: numbers[key].get(name) for head, key in ends.items()}
        | numbers["peak_power"][name]
        for name in names
    ]
    yield records(f"{title}: most driving / braking torque; negative speeds mirror both", limits)
    yield records("\nSpeeds and greatest power", models)
    yield f"no-load speed {cell(numbers['no_load_speed'])}"
    yield records("\nWhat the d-axis voltage costs, at shares of the no-load speed", numbers["d_axis_cost"])
    yield "\nspeed in rad/s, torque in N m, power in W, all on the joint's side of the gear"


@checked
def actuators(name: str | None = None, *, save: Path | None = None) -> Drawn:
    """Compare the actuators of the library, or print one with the source of every number.

    Example: sprintlab motor library xiaomi-cybergear

    Args:
        name: name of one actuator; all of them when left out.
        save: write the chosen actuator's motor as a motor file (TOML) for the other commands.
    """
    if save is not None and name is None:
        raise InvalidValueError("save", str(save), "name the actuator to save")
    known = {each: load_library_motor(each) for each in (library_motors() if name is None else (name,))}
    numbers = [_actuator_numbers(each) for each in known.values()]
    shown: list[RenderableType]
    if name is None:
        rows = [{key: each[key] for key in each if key not in ("title", "values")} for each in numbers]
        note = "joint side, rad/s and N m; corner: highest speed with peak torque; lost: share that v_d takes"
        shown = [records("Actuators", rows), note]
    else:
        rows = [{"quantity": key, **item} for key, item in numbers[0]["values"].items()]
        shown = [records(numbers[0]["title"], rows)]
    if name is not None and save is not None:
        motors.save_motor(known[name].motor, save)
        shown.append(f"motor file: {save}")
    whole = [load_library_motor(each) for each in library_motors()]
    draw = drawn("evaluation.motor_figures.library_figure", whole)
    return Drawn(numbers=numbers, shown=shown, found=known, draw=draw)


def _actuator_numbers(actuator: LibraryMotor) -> dict[str, Any]:
    """What follows at the joint in N m, A and rad/s, and every number with its source."""
    drive = JointDrive(motor=actuator.motor, gear=actuator.gear, bus_voltage=actuator.bus_voltage)
    refined, simple = (chart.peak_torque_speed(drive, name) or 0.0 for name in ("refined", "simplified-dc"))
    units = {"bus_voltage": "V", **MOTOR_UNITS}
    values = {
        key: {"value": item.value, "unit": units.get(key.rpartition(".")[2], ""), "estimated": item.estimated,
              "source": item.source} for key, item in actuator.values.items()
    }  # fmt: skip
    return {
        "name": actuator.name,
        "bus_V": actuator.bus_voltage,
        "gear": float(actuator.gear.ratio),
        "peak_torque": float(chart.joint_limits(drive, np.zeros(1), chart.SATURATED)[1][0]),
        "peak_current": float(actuator.motor.peak_torque / actuator.motor.torque_constant),
        "no_load_speed": drive.no_load_speed,
        "corner_speed": refined,
        "corner_v_d_0": simple,
        "lost": 1.0 - refined / simple if simple > 0.0 else 0.0,
        "estimated": sum(item["estimated"] for item in values.values()),
        "title": actuator.title,
        "values": values,
    }


@checked
def motor_from_datasheet(
    sheet: Path | None = None,
    *,
    template: bool = False,
    output: Path | None = None,
    supply_output: Path | None = None,
) -> Result:
    """Turn a data sheet into a motor file; name what is ambiguous or contradictory, guess nothing.

    Example: sprintlab motor from-datasheet sheet.toml --output my-motor.toml

    Args:
        sheet: the data sheet (TOML): entries as printed, with their units and conventions.
        template: print a blank data sheet and do nothing else.
        output: motor file to write.
        supply_output: file for --supply to write: the drive's I²t and the heat of winding and housing.
    """
    if template:
        return Result(numbers={"template": datasheet_template()}, shown=[datasheet_template().rstrip("\n")])
    if sheet is None:
        raise InvalidValueError("sheet", None, "name a data sheet, or print a blank one with --template")
    if output and supply_output and os.path.realpath(output) == os.path.realpath(supply_output):
        raise InvalidValueError("supply_output", str(supply_output), "another file than --output")
    loaded = load_datasheet(sheet)
    conversion = datasheet.convert_datasheet(loaded)
    if output is not None:
        datasheet.save_converted_motor(conversion, loaded, output)
    if supply_output is not None:
        datasheet.save_converted_supply(conversion, supply_output)
    numbers = datasheet.conversion_numbers(conversion)
    columns = ("quantity", "formula", "numbers", "result", "unit")
    rows = (map(cell, step.values()) for step in numbers["steps"])
    shown: list[RenderableType] = [
        table(loaded.name or Path(sheet).stem, *columns, numbers=("result",), rows=rows),
        _motor_table("\nMotor", numbers["motor"]),
        *(f"note: {note}" for note in numbers["notes"]),
    ]
    files = {"motor file": output, "supply file": supply_output}
    shown += [f"{what}: {path}" for what, path in files.items() if path is not None]
    return Result(numbers=numbers, shown=shown, found=conversion)


@checked
def identify_motor(
    bench: Path | str,
    *,
    pole_pairs: int | None = None,
    peak_current: float | None = None,
    base: Path | str | None = None,
    hold: Sequence[str] = (),
    also: Sequence[str] = (),
    window: float = 0.1,
    rotor_inertia: float | None = None,
    column: Sequence[str] = (),
    gear_ratio: float = 1.0,
    motor_speed: bool = False,
    saturation_only: bool = False,
    output: Path | str | None = None,
) -> Drawn:
    """Fit resistance, inductance, flux, saturation, friction and usable voltage to bench data.

    The status is 1 when the model does not describe the data.
    Example: sprintlab motor identify bench.csv --pole-pairs 21 --peak-current 62.7 --output found.toml

    Args:
        bench: steady points or a log (CSV), units in its header: speed, iq and torque; better also vq, vd,
            power, bus_voltage, temperature and limited (1 where the inverter gives all its voltage).
        pole_pairs: pole pairs of the motor; the base motor's when left out.
        peak_current: amplitude of the drive's current limit [A]; the base motor's when left out.
        base: motor file, robot or actuator that supplies what the bench does not determine.
        hold: parameters that are not fitted but taken from the base motor.
        also: fitted only on request: torque_offset, current_offset, gear_efficiency, rotor_inertia.
        window: length of the windows of a log with a time column in which current and speed rest [s].
        rotor_inertia: rotor inertia [kg m^2] for the motor file; the base motor's when left out.
        column: name=heading or name=heading:unit, for a column with another heading in the file.
        gear_ratio: ratio of a gear between the motor and the torque sensor; results are the motor's.
        motor_speed: although there is a gear, the recorded speed is the motor's.
        saturation_only: the file is a torque-current table at one speed; fit flux and saturation alone.
        output: motor file to write.
    """
    if output is not None:
        check_writable_file(output)
    known = None
    if base is not None:
        named = str(base)
        known = file_motor(named)[0] if named.endswith(".toml") else chosen_motor(named, "").drive.motor
        pole_pairs = pole_pairs or int(known.pole_pairs)
        peak_current = peak_current or float(known.peak_torque / known.torque_constant)
    if pole_pairs is None:
        raise InvalidValueError("pole_pairs", None, "give --pole-pairs or --base: it is counted, not fitted")
    data = identification.load_bench(bench, needs_speed=not saturation_only, columns=column)
    if identification.is_log(data, window):
        data = identification.rested(data, window, "rotor_inertia" in also)
    data = identification.behind_gear(data, gear_ratio, motor_speed)
    if saturation_only:
        data = replace(data, speed=None, q_voltage=None, d_voltage=None, power=None)
    found = identification.identify(
        data, pole_pairs=pole_pairs, peak_current=peak_current, base=known, hold=hold, also=also
    )
    name, numbers = Path(bench).stem, _identified_numbers(found)
    motor = Drawn(
        numbers=numbers,
        shown=list(_identified_shown(name, found, numbers)),
        found=found,
        draw=drawn("evaluation.motor_figures.identification_figure", found, name),
        status=0 if found.trustworthy else 1,
    )
    if output is None:
        return motor
    with kept(motor):
        motors.save_motor(found.motor(known, rotor_inertia), output)
    return replace(motor, shown=[*motor.shown, f"motor file: {output}"])


def _identified_numbers(found: identification.Identification) -> dict[str, Any]:
    """Estimates, fit quality and warnings."""
    units = identification.PARAMETER_UNITS | identification.OPTIONAL_UNITS
    return {
        "trustworthy": found.trustworthy,
        "pole_pairs": found.pole_pairs,
        "peak_current": found.peak_current,
        "torque_constant": found.torque_constant,
        "parameters": {name: {**asdict(each), "unit": units[name]} for name, each in found.estimates.items()},
        "channels": [
            {"quantity": fit.name, "rows": len(fit.rows), "noise": fit.noise, "explained": fit.explained}
            for fit in found.channels
        ],
        "outlier_lines": found.outliers.tolist(),
        "warnings": list(found.warnings),
    }


def _identified_shown(
    title: str, found: identification.Identification, numbers: dict[str, Any]
) -> Iterator[RenderableType]:
    """Parameters with their intervals, fit, outliers, warnings."""
    columns = ("value", "95 % interval")
    made = table(title, "parameter", *columns, "unit", "", numbers=columns)
    for name, each in numbers["parameters"].items():
        width, unknown = each["half_width"], each["value"] is None or not each["determined"]
        interval = "-" if width is None else f"± {width:.2g}"
        why = f"not determined: {each['reason']}" if unknown else each["reason"]
        made.add_row(name, cell(each["value"]), interval, each["unit"], why)
    yield made
    yield records("\nFit", numbers["channels"])
    if lines := [str(line) for line in numbers["outlier_lines"]]:
        yield f"outliers in lines {', '.join(lines[:12])}{' ...' if len(lines) > 12 else ''}"
    yield from (f"warning: {warning}" for warning in found.warnings)
    if found.bench.unused:
        yield f"columns not read: {', '.join(found.bench.unused)}"
