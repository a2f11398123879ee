"""Motors: by name, from a data sheet, from a bench; and what they give at which speed."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import RenderableType
from rich.table import Table

from sprintlab.api.results import Drawn, Result, kept, styled, table
from sprintlab.core.arguments import checked
from sprintlab.core.checks import check_range
from sprintlab.core.errors import InvalidValueError, SprintlabError
from sprintlab.core.files import check_writable_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sprintlab.evaluation.operating_points import OperatingPoints
    from sprintlab.motors import Gear, LibraryMotor, PmsmParameters
    from sprintlab.motors.chart import JointDrive
    from sprintlab.workbench.identification import Identification

SHORT_NAMES = {"simplified-dc": "v_d = 0", "refined + saturation": "refined + sat."}


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ChosenMotor(Result):
    """A motor with its gear and bus voltage.

    Attributes:
        drive: motor, gear and bus voltage as plain numbers.
        title: for tables and figures.
        joints: columns of a trajectory that this motor drives; empty for a motor file.
    """

    drive: JointDrive
    title: str
    joints: tuple[int, ...]


@checked
def chosen_motor(
    source: str = "bp2",
    joint: str = "hip",
    *,
    bus_voltage: float | None = None,
    gear_ratio: float | None = None,
    gear_efficiency: float | None = None,
) -> ChosenMotor:
    """Print a motor's parameters and the speeds that follow from them, behind the gear if one is given.

    Args:
        source: a motor file or a data sheet (TOML), the name of a robot, or an actuator of the library.
        joint: which motor of the robot: abad, hip, knee, or a full name such as RL_hip.
        bus_voltage: [V]; the robot's or actuator's own when left out, needed for a file, which has none.
        gear_ratio: motor speed over joint speed; the robot's or actuator's own, or 1 for a motor file.
        gear_efficiency: the robot's or actuator's own, or 1 for a motor file.

    Raises:
        SprintlabError: no such robot or file; ``InvalidValueError``: no such joint, a bad voltage or gear.
    """
    from sprintlab.motors import library_motors
    from sprintlab.motors.chart import JointDrive, peak_torque_speed
    from sprintlab.motors.voltage import check_bus_voltage

    if bus_voltage is not None:
        check_bus_voltage(bus_voltage)
    if source.endswith(".toml"):
        if bus_voltage is None:
            raise SprintlabError(f"bus_voltage is not given: {source} describes a motor without its bus")
        motor, gear, own_voltage, name, joints = *file_motor(source), bus_voltage, Path(source).stem, ()
    elif source in library_motors():
        motor, gear, own_voltage, name, joints = _from_library(source)
    else:
        motor, gear, own_voltage, name, joints = _from_robot(source, joint)
    given = {"ratio": gear_ratio, "efficiency": gear_efficiency}
    gear = replace(gear, **{name: value for name, value in given.items() if value is not None})
    drive = JointDrive(motor=motor, gear=gear, bus_voltage=bus_voltage or own_voltage)
    title = f"{name} at {drive.bus_voltage:g} V" + (f", gear {gear.ratio:g}" if gear.ratio != 1.0 else "")
    parameters = {item.name: float(getattr(motor, item.name)) for item in fields(motor)}
    speeds = {
        "no_load_speed": drive.no_load_speed,
        "critical_speed_refined": peak_torque_speed(drive, "refined") or 0.0,
        "critical_speed_v_d_0": peak_torque_speed(drive, "simplified-dc") or 0.0,
    }
    constant, kv = float(motor.torque_constant), float(motor.speed_constant) * 60.0 / (2.0 * math.pi)
    numbers = {
        "motor": parameters, "torque_constant": constant, "kv": kv, "bus_voltage": drive.bus_voltage, **speeds
    }  # fmt: skip
    note = (
        f"torque constant {constant:.4g} N m/A, per ampere of phase amplitude; "
        f"KV {kv:.4g} rpm/V, per volt of the line-to-line amplitude"
    )
    shown = [_motor_table(title, "quantity", {**parameters, **speeds}), note]
    return ChosenMotor(numbers=numbers, shown=shown, drive=drive, title=title, joints=joints)


@checked
def show_motor(source: str = "bp2", joint: str = "hip", *, bus_voltage: float | None = None) -> ChosenMotor:
    """Print a motor's parameters and the speeds that follow from them, motor side.

    Args:
        source: a motor file or a data sheet (TOML), the name of a robot, or an actuator of the library.
        joint: which motor of the robot: abad, hip, knee, or a full name such as RL_hip.
        bus_voltage: [V]; the robot's or actuator's own when left out, needed for a file, which has none.

    Raises:
        SprintlabError: as ``chosen_motor``.
    """
    return chosen_motor(source, joint, bus_voltage=bus_voltage, gear_ratio=1.0, gear_efficiency=1.0)


def _motor_table(title: str, heading: str, values: Mapping[str, float]) -> Table:
    """A motor's parameters and speeds [rad/s] by name, one a row, with their units."""
    from sprintlab.motors.parameters import MOTOR_UNITS

    rows = ((name, f"{value:.5g}", MOTOR_UNITS.get(name, "rad/s")) for name, value in values.items())
    return table(title, heading, "value", "unit", rows=rows)


_Source = tuple[Any, Any, float, str, tuple[int, ...]]  # motor, gear, bus voltage, name, columns


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


def _from_library(source: str) -> _Source:
    from sprintlab.motors import load_library_motor

    actuator = load_library_motor(source)
    return actuator.motor, actuator.gear, actuator.bus_voltage, source, ()


def _from_robot(source: str, joint: str) -> _Source:
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
    motor, gear = single(robot.motors, chosen[0]), single(robot.gear, chosen[0])
    return motor, gear, float(robot.bus_voltage), f"{source} {joint} motor", tuple(chosen)


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
) -> Drawn:
    """Print and draw the torque-speed envelope of a joint under every motor model, all four quadrants.

    Args:
        source: a motor file or a data sheet (TOML), the name of a robot, or an actuator of the library.
        joint: which motor of the robot: abad, hip, knee, or a full name such as RL_hip.
        bus_voltage: [V]; the robot's or actuator's own when left out, needed for a file, which has none.
        gear_ratio: motor speed over joint speed; the robot's or actuator's own, or 1 for a motor file.
        gear_efficiency: the robot's or actuator's own, or 1 for a motor file.
        trajectory: trajectory.npz of a race, drawn over the envelope and compared with it.
        points: speeds in the table, from standstill to the no-load speed.

    Raises:
        SprintlabError: an unknown source or joint, a bad number, or the file is no trajectory of a race.
    """
    from sprintlab.evaluation.operating_points import load_operating_points
    from sprintlab.robots import load_robot

    def draw() -> Figure:
        from sprintlab.evaluation.motor_figures import workbench_figure

        return workbench_figure(chosen.drive, chosen.title, operated)

    check_range("points", points, 2, 10_000)
    chosen = chosen_motor(
        source, joint, bus_voltage=bus_voltage, gear_ratio=gear_ratio, gear_efficiency=gear_efficiency
    )
    operated = None
    if trajectory is not None:
        names = load_robot("bp2").joint_names  # whose joints a motor alone is compared with
        columns = chosen.joints or tuple(place for place, name in enumerate(names) if name.endswith(joint))
        operated = load_operating_points(trajectory, columns)
    numbers = _envelope_numbers(chosen.drive, points, operated)
    shown = list(_envelope_shown(chosen.title, numbers))
    return Drawn(numbers=numbers, shown=shown, found=chosen, draw=draw)


def _envelope_numbers(drive: JointDrive, points: int, operated: OperatingPoints | None) -> dict[str, Any]:
    """Speeds [rad/s], torques [N m] and powers [W] behind the gear.

    ``NAME upper`` bounds driving and ``NAME lower`` braking; negative speeds mirror both.
    """
    import numpy as np

    from sprintlab.motors import MOTOR_MODELS, chart

    columns = {"speed": np.linspace(0.0, drive.no_load_speed, points)}
    for name in chart.envelope_names():
        limits = chart.joint_limits(drive, columns["speed"], name)
        columns |= {f"{name} {side}": limit for side, limit in zip(("lower", "upper"), limits, strict=True)}
    numbers = {
        "bus_voltage": drive.bus_voltage,
        "gear": asdict(drive.gear),
        "side": "joint",
        "no_load_speed": drive.no_load_speed,
        "critical_speed": {model: chart.peak_torque_speed(drive, model) for model in MOTOR_MODELS},
        "end_of_drive": {model: chart.end_of_drive(drive, model) for model in MOTOR_MODELS},
        "peak_power": {name: chart.peak_power(drive, name) for name in chart.envelope_names()},
        "d_axis_cost": [chart.d_axis_cost(drive, share) for share in chart.D_AXIS_SHARES],
        "rows": [{name: float(values[i]) for name, values in columns.items()} for i in range(points)],
    }
    return numbers if operated is None else {**numbers, "operating_points": operated.summary(drive)}


def _envelope_shown(title: str, numbers: dict[str, Any]) -> Iterator[RenderableType]:
    """Limits by speed, the models' ends and powers, the cost of the d-axis, the recorded run."""
    rows = numbers["rows"]
    names = [name.removesuffix(" upper") for name in rows[0] if name.endswith(" upper")]
    headings = [str(SHORT_NAMES.get(name, name)) for name in names]
    limits = table(title, "speed", "", *headings, numbers=("speed", *headings))
    for row in rows:
        limits.add_row(_text(row["speed"]), "drive", *(_text(row[f"{name} upper"]) for name in names))
        limits.add_row("", "brake", *(_text(row[f"{name} lower"]) for name in names), style="dim")
    yield limits
    yield styled("[dim]driving torque, braking torque below it; negative speeds mirror both[/]\n")
    columns = ("whole peak torque up to", "drives up to", "most power", "at speed", "with torque")
    models = table("Speeds and power", "model", *columns, numbers=columns)
    for name, power in numbers["peak_power"].items():
        model = name if name in numbers["critical_speed"] else "refined"
        ends = (_text(numbers[key][model]) for key in ("critical_speed", "end_of_drive"))
        values = (f"{power['power']:.0f}", _text(power["speed"]), _text(power["torque"]))
        models.add_row(SHORT_NAMES.get(name, name), *ends, *values)
    models.add_row("no-load speed", "", _text(numbers["no_load_speed"]))
    yield models
    yield ""
    columns = ("speed", "v_d = 0", "refined", "lost", "|v_d| / V")
    costs = (
        (
            f"{cost['share']:.0%}",
            *(_text(cost[key]) for key in ("speed", "torque_without", "torque")),
            f"{cost['lost']:.1%}",
            f"{cost['voltage_share']:.2f}",
        )
        for cost in numbers["d_axis_cost"]
    )
    what = "What the d-axis voltage costs"
    yield table(what, "share of the no-load speed", *columns, numbers=columns, rows=costs)
    if "operating_points" in numbers:
        points = numbers["operating_points"]
        yield ""
        beyond = points["beyond"].items()
        yield table("Operating points of the trajectory", "quantity", "value", rows=[
            ("samples", f"{points['samples']:.0f}"),
            ("highest speed over no-load speed", f"{points['speed_ratio']:.3f}"),
            ("greatest torque over the peak torque", f"{points['torque_ratio']:.3f}"),
            ("share on the envelope, refined + sat.", f"{points['at_limit']:.2%}"),
            *((f"share beyond {SHORT_NAMES.get(name, name)}", f"{share:.2%}") for name, share in beyond),
        ])  # fmt: skip
    yield "\nspeed in rad/s, torque in N m, power in W, all on the joint's side of the gear"


def _text(value: float | None) -> str:
    """Two decimals, three below 10; no negative zero."""
    if value is None:
        return "no limit"
    return f"{round(value, 3) + 0.0:.{2 if abs(value) >= 10 else 3}f}"


@checked
def actuators(name: str | None = None, *, save: Path | None = None) -> Drawn:
    """Compare the actuators of the library, or print one with the source of every number.

    Args:
        name: one actuator; all of them when left out.
        save: write the chosen actuator's motor as a motor file (TOML) for the other commands.

    Raises:
        InvalidValueError: no actuator has that name.
    """
    from sprintlab.motors import library_motors, load_library_motor, save_motor

    def draw() -> Figure:
        from sprintlab.evaluation.motor_figures import library_figure

        return library_figure([load_library_motor(each) for each in library_motors()])

    if save is not None and name is None:
        raise InvalidValueError("save", str(save), "name the actuator to save")
    known = {each: load_library_motor(each) for each in (library_motors() if name is None else (name,))}
    numbers = [_actuator_numbers(each) for each in known.values()]
    whole: list[RenderableType] = [_comparison(numbers), LIBRARY_NOTE]
    shown: list[RenderableType] = whole if name is None else [_sources(numbers[0])]
    if name is not None and save is not None:
        save_motor(known[name].motor, save)
        shown.append(f"motor file: {save}")
    return Drawn(numbers=numbers, shown=shown, found=known, draw=draw)


LIBRARY_NOTE = (
    "joint side, speeds in rad/s, torques in N m; corner: up to there the peak torque fits; "
    "lost: what v_d takes from the corner; estimated: numbers without a published source"
)


def _actuator_numbers(actuator: LibraryMotor) -> dict[str, Any]:
    """Every number with its source, and what follows behind the gear."""
    from sprintlab.motors.parameters import MOTOR_UNITS

    units = {"bus_voltage": "V", **MOTOR_UNITS}
    values = {
        key: {
            "value": item.value, "unit": units.get(key.rpartition(".")[2], ""), "source": item.source,
            "estimated": item.estimated,
        }
        for key, item in actuator.values.items()
    }  # fmt: skip
    told = {"name": actuator.name, "title": actuator.title}
    return {**told, "values": values, "joint": joint_numbers(actuator)}


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


def _comparison(actuators: Sequence[dict[str, Any]]) -> Table:
    columns = (
        "bus",
        "gear",
        "peak torque",
        "peak current",
        "no load",
        "corner",
        "v_d = 0",
        "lost",
        "estimated",
    )
    keys = ("peak_torque", "peak_current", "no_load_speed", "corner_speed", "corner_speed_v_d_0")
    made = table("Actuators", "name", *columns, numbers=columns)
    for each in actuators:
        values, joint = each["values"], each["joint"]
        made.add_row(
            each["name"],
            f"{values['bus_voltage']['value']:g} V",
            f"{values['gear.ratio']['value']:g}",
            *(f"{joint[key]:.1f}" for key in keys),
            f"{100 * joint['corner_lost_to_v_d']:.0f} %",
            str(sum(value["estimated"] for value in values.values())),
        )
    return made


def _sources(actuator: dict[str, Any]) -> Table:
    made = table(actuator["title"], "quantity", "value", "unit", "", "source")
    made.columns[-1].overflow = "fold"
    for name, item in actuator["values"].items():
        mark = styled("[yellow]estimated[/]") if item["estimated"] else ""
        made.add_row(name, f"{item['value']:.5g}", item["unit"], mark, item["source"])
    return made


@checked
def motor_from_datasheet(
    sheet: Path | None = None,
    *,
    template: bool = False,
    output: Path | None = None,
    supply_output: Path | None = None,
    tolerance: float = 0.05,
) -> Result:
    """Turn a data sheet into a motor file; name what is ambiguous or contradictory, guess nothing.

    Args:
        sheet: the data sheet (TOML): entries as printed, with their units and conventions.
        template: print a blank data sheet and do nothing else.
        output: motor file to write; none when left out.
        supply_output: supply file to write for --supply of race and evaluate: the drive's I²t as [i2t],
            winding and housing as [heat], where the sheet gives them.
        tolerance: difference between entries that say the same, taken for rounding.

    Raises:
        SprintlabError: the sheet is unreadable, unclear or wrong, or a file cannot be written.
    """
    from sprintlab.workbench import datasheet
    from sprintlab.workbench.datasheet_file import datasheet_template, load_datasheet

    if template:
        return Result(numbers={"template": datasheet_template()}, shown=[datasheet_template().rstrip("\n")])
    if sheet is None:
        raise InvalidValueError("sheet", None, "name a data sheet, or print a blank one with --template")
    if output and supply_output and os.path.realpath(output) == os.path.realpath(supply_output):
        raise InvalidValueError("supply_output", str(supply_output), "another file than --output")
    loaded = load_datasheet(sheet)
    conversion = datasheet.convert_datasheet(loaded, tolerance)
    if output is not None:
        datasheet.save_converted_motor(conversion, loaded, output)
    if supply_output is not None:
        datasheet.save_converted_supply(conversion, supply_output)
    numbers = datasheet.conversion_numbers(conversion)
    columns = ("quantity", "formula", "numbers", "result", "unit")
    rows = ({**step, "value": f"{step['value']:.5g}"}.values() for step in numbers["steps"])
    shown: list[RenderableType] = [
        table(loaded.name or Path(sheet).stem, *columns, numbers=("result",), rows=rows),
        "",
        _motor_table("Motor", "parameter", numbers["motor"]),
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

    The bench is a CSV of steady points with units in its header: speed [rad/s], iq [A] (or phase_current
    [A rms]) and torque [N m]; better also vq [V], vd [V], power [W], bus_voltage [V], temperature [degC] and
    limited (1 where the inverter gives all its voltage). The status is 1 when the model does not describe the
    data.

    Args:
        bench: the measurements (CSV).
        pole_pairs: pole pairs of the motor; the base motor's when left out.
        peak_current: amplitude of the drive's current limit [A], to which saturation and peak torque refer;
            the base motor's when left out.
        base: motor file, robot or actuator that supplies what the bench does not determine.
        hold: parameters not fitted but taken from the base motor (friction and flux_drift: 0,
            voltage_utilization: 0.95).
        also: parameters fitted only on request: torque_offset and current_offset (what the sensors read at
            zero), gear_efficiency (a gear that loses a share of the load), rotor_inertia (of a log).
        window: for a log with a time column, e.g. 100 rows a second: means over windows of this length [s] in
            which current and speed rest.
        rotor_inertia: [kg m^2] for the motor file; the base motor's when left out.
        column: name=heading or name=heading:unit, for a column that the file calls otherwise.
        gear_ratio: ratio of a gear between the motor and the torque sensor; results are the motor's.
        motor_speed: behind a gear, the speed is the motor's already.
        saturation_only: the file is a torque-current table at one speed; fit flux and saturation alone.
        output: motor file to write; none when left out.

    Raises:
        SprintlabError: the bench cannot be used, or a choice is refused.
        UnwrittenError: the disk has no room for the file any more; its ``found`` is the motor.
    """
    if output is not None:
        check_writable_file(output)
    from sprintlab.motors import save_motor
    from sprintlab.workbench.identification import behind_gear, identify, is_log, load_bench, rested

    def draw() -> Figure:
        from sprintlab.evaluation.motor_figures import identification_figure

        return identification_figure(found, name)

    known = None
    if base is not None:
        named = str(base)
        known = file_motor(named)[0] if named.endswith(".toml") else chosen_motor(named, "").drive.motor
    if pole_pairs is None:
        if known is None:
            raise InvalidValueError(
                "pole_pairs", None, "give --pole-pairs or --base: it is counted, not fitted"
            )
        pole_pairs = int(known.pole_pairs)
    if peak_current is None and known is not None:
        peak_current = float(known.peak_torque / known.torque_constant)
    data = load_bench(bench, needs_speed=not saturation_only, columns=column)
    if is_log(data, window):
        data = rested(data, window, "rotor_inertia" in also)
    data = behind_gear(data, gear_ratio, motor_speed)
    if saturation_only:
        data = replace(data, speed=None, q_voltage=None, d_voltage=None, power=None)
    found = identify(data, pole_pairs=pole_pairs, peak_current=peak_current, base=known, hold=hold, also=also)
    name, numbers = Path(bench).stem, _identified_numbers(found)
    shown, status = list(_identified_shown(name, found, numbers)), 0 if found.trustworthy else 1
    motor = Drawn(numbers=numbers, shown=shown, found=found, draw=draw, status=status)
    if output is None:
        return motor
    with kept(motor):
        save_motor(found.motor(known, rotor_inertia), output)
    return replace(motor, shown=[*motor.shown, f"motor file: {output}"])


def _identified_numbers(found: Identification) -> dict[str, Any]:
    """Estimates, fit quality and warnings."""
    from sprintlab.workbench.identification import OPTIONAL_UNITS, PARAMETER_UNITS

    units = PARAMETER_UNITS | OPTIONAL_UNITS
    estimates = {
        name: {
            "value": each.value, "half_width_95": each.half_width, "unit": units[name],
            "determined": each.determined, "reason": each.reason,
        }
        for name, each in found.estimates.items()
    }  # fmt: skip
    return {
        "trustworthy": found.trustworthy,
        "pole_pairs": found.pole_pairs,
        "peak_current": found.peak_current,
        "torque_constant": found.torque_constant,
        "parameters": estimates,
        "channels": {
            fit.name: {
                "noise": fit.noise,
                "unit": fit.unit,
                "explained": fit.explained,
                "rows": len(fit.rows),
            }
            for fit in found.channels
        },
        "outlier_lines": found.outliers.tolist(),
        "singular_values": found.singular_values.tolist(),
        "warnings": list(found.warnings),
    }


def _identified_shown(title: str, found: Identification, numbers: dict[str, Any]) -> Iterator[RenderableType]:
    """Parameters with their intervals, fit, outliers, warnings."""
    columns = ("value", "95 % interval")
    made = table(title, "parameter", *columns, "unit", "", numbers=columns)
    for name, each in numbers["parameters"].items():
        value, width = each["value"], each["half_width_95"]
        unknown = value is None or not each["determined"]
        made.add_row(
            name,
            "-" if value is None else f"{value:.5g}",
            "-" if width is None else f"± {width:.2g}",
            each["unit"],
            f"not determined: {each['reason']}" if unknown else each["reason"],
            style="dim" if unknown else None,
        )
    yield made
    yield ""
    columns = ("rows", "noise (1 sigma)", "explained")
    rows = (
        (name, str(fit["rows"]), f"{fit['noise']:.3g}", f"{fit['explained']:.2%}", fit["unit"])
        for name, fit in numbers["channels"].items()
    )
    yield table("Fit", "quantity", *columns, "unit", numbers=columns, rows=rows)
    if lines := [str(line) for line in numbers["outlier_lines"]]:
        yield f"outliers in lines {', '.join(lines[:12])}{' ...' if len(lines) > 12 else ''}"
    yield from (f"warning: {warning}" for warning in found.warnings)
    if found.bench.unused:
        yield f"columns not read: {', '.join(found.bench.unused)}"
