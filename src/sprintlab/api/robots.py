"""Robots: their numbers with unit and basis, their names, and new ones from an MJCF or URDF."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

from sprintlab import robots
from sprintlab.api.results import Result, records
from sprintlab.core.arguments import check_kind, checked
from sprintlab.core.errors import RobotModelError
from sprintlab.robots import importing

JOINTS = ("abad", "hip", "knee")


@checked
def show_robot(name: str = "bp2") -> Result:
    """Print every number of a robot with unit, uncertainty and basis.

    Example: sprintlab robot show go1

    Args:
        name: the robot, e.g. bp2, or the path of its folder or table.
    """
    found = [asdict(row) for row in robots.parameter_table(name)]
    return Result(numbers=found, shown=[records(f"Robot {name}", found)])


def list_robots() -> Result:
    """List the robots that come with the package, and those in ./robots."""
    names = list(robots.robot_names())
    return Result(numbers=names, shown=[name.replace("\n", "\\n") for name in names])


@checked
def import_robot(
    source: str | Path,
    *,
    choices: str | Path | Any | None = None,
    name: str | None = None,
    abad_motor: str | None = None,
    hip_motor: str | None = None,
    knee_motor: str | None = None,
    abad_gear: float | None = None,
    hip_gear: float | None = None,
    knee_gear: float | None = None,
    bus_voltage: float | None = None,
    output: str | Path = "robots",
) -> Result:
    """Make a robot from an MJCF or URDF: its parameter table and the map of its joints.

    Motors, gears and the bus voltage come from options or from the file of choices.
    Example: sprintlab robot new examples/go1/go1.xml --choices examples/go1/choices.toml --name mydog

    Args:
        source: MJCF or URDF of a quadruped with three hinges a leg.
        choices: TOML file (from Python also sl.RobotChoices) of motors, gears and gains; options override it.
        name: name of the robot; by default the file's name.
        abad_motor: motor file, name of a library motor, or ROBOT:JOINT such as bp2:abad.
        hip_motor: the same for the hips.
        knee_motor: the same for the knees.
        abad_gear: gear ratio, motor speed over joint speed.
        hip_gear: the same for the hips.
        knee_gear: the same for the knees.
        bus_voltage: [V].
        output: folder in which the robot's folder is put; in ./robots robots are found by name.
    """
    check_kind("choices", choices, importing.RobotChoices | str | Path | None)
    read = importing.read_source(Path(source), 0.02)
    if not isinstance(choices, importing.RobotChoices):
        given: dict[str, Any] = {} if choices is None else importing.read_choices(Path(choices))
        options = {"name": name, "bus_voltage": bus_voltage}
        given = {"name": read.path.stem, **given, **{key: v for key, v in options.items() if v is not None}}
        given["joints"] = tables = {joint: dict(given.get("joints", {}).get(joint, {})) for joint in JOINTS}
        missing = [] if "bus_voltage" in given else ["--bus-voltage"]
        motors, gears = (abad_motor, hip_motor, knee_motor), (abad_gear, hip_gear, knee_gear)
        for joint, motor, gear in zip(JOINTS, motors, gears, strict=True):
            for field, value in (("motor", motor), ("gear_ratio", gear)):
                if value is not None:
                    tables[joint][field] = value
                elif field not in tables[joint]:
                    missing.append(f"--{joint}-{field.partition('_')[0]}")
        if missing:
            names = ", ".join(missing)
            raise RobotModelError(f"not given: {names}; a file of --choices can hold them, too")
        choices = importing.make_choices(given, str(choices))
    made = importing.import_robot(read, choices, Path(output))
    checks = [asdict(check) for check in made.checks]
    shown = [
        records(f"Robot {made.robot.name} from {read.path}", checks),
        f"written: {made.folder}/ (parameters.toml, joints.json)",
        f"next: sprintlab robot show {made.folder}; sprintlab train {made.folder}",
    ]
    numbers = {"folder": str(made.folder), "robot": made.robot.name, "checks": checks}
    return Result(numbers=numbers, shown=shown, found=made)
