"""Robots: their numbers with unit and basis, their names, and new ones from an MJCF or URDF."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

from sprintlab import robots
from sprintlab.api.results import Result, records
from sprintlab.core.arguments import check_kind, checked
from sprintlab.robots import importing


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
    source: str | Path, *, choices: str | Path | Any, name: str | None = None, output: str | Path = "robots"
) -> Result:
    """Make a robot from an MJCF or URDF: its parameter table and the map of its joints.

    Example: sprintlab robot new examples/go1/go1.xml --choices examples/go1/choices.toml --name mydog

    Args:
        source: MJCF or URDF of a quadruped with three hinges per leg.
        choices: TOML file (from Python also sl.RobotChoices) of bus voltage, motors, gears and gains.
        name: name of the robot; the file's when left out.
        output: folder in which the robot's folder is put; in ./robots robots are found by name.
    """
    check_kind("choices", choices, importing.RobotChoices | str | Path)
    read = importing.read_source(Path(source), 0.02)
    if not isinstance(choices, importing.RobotChoices):
        given = {"name": read.path.stem, **importing.read_choices(Path(choices))}
        choices = importing.make_choices(given | ({} if name is None else {"name": name}), str(choices))
    made = importing.import_robot(read, choices, Path(output))
    checks = [asdict(check) for check in made.checks]
    shown = [
        records(f"Robot {made.robot.name} from {read.path}", checks),
        f"written: {made.folder}/ (parameters.toml, joints.json)",
        f"next: sprintlab robot show {made.folder}; sprintlab train {made.folder}",
    ]
    numbers = {"folder": str(made.folder), "robot": made.robot.name, "checks": checks}
    return Result(numbers=numbers, shown=shown, found=made)
