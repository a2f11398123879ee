"""``robot show``, ``list`` and ``new``: robots, where their numbers come from, and robots of one's own."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sprintlab.api.results import PlainConsole, Result, table
from sprintlab.core.arguments import check_kind, checked
from sprintlab.core.errors import RobotModelError

if TYPE_CHECKING:
    from sprintlab.robots.description import RobotDescription

JOINTS = ("abad", "hip", "knee")


@checked
def show_robot(name: str = "bp2") -> Result:
    """Print every number of a robot with unit, uncertainty and basis.

    Args:
        name: the robot, e.g. bp2, or the path of its folder or table.

    Raises:
        RobotModelError: an unknown robot, or a broken table.
    """
    from sprintlab.robots import parameter_table

    columns = ("quantity", "value", "unit", "uncertainty", "basis")
    found = [asdict(row) for row in parameter_table(name)]
    rows = ([_text(row["value"]) if key == "value" else row[key] for key in columns] for row in found)
    return Result(numbers=found, shown=[table(f"Robot {name}", *columns, rows=rows)])


def _text(value: Any) -> str:
    """A number or a tuple of numbers with at most five significant digits."""
    if isinstance(value, tuple | list):
        return ", ".join(map(_text, value))
    return f"{value:.5g}" if isinstance(value, int | float) else str(value)


def list_robots() -> Result:
    """List the robots that come with the package, and those in ./robots."""
    from sprintlab.robots import robot_names

    return Result(numbers=list(robot_names()), shown=[name.replace("\n", "\\n") for name in robot_names()])


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class RobotImport(Result):
    """What an import made; prints how the robot compares with the model that it came from.

    Attributes:
        folder: with ``parameters.toml`` and ``joints.json``.
        robot: as it is read back from there.
    """

    folder: Path
    robot: RobotDescription


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
    foot_radius: float | None = None,
    output: str | Path = "robots",
) -> RobotImport:
    """Make a robot from an MJCF or URDF: its parameter table and the map of its joints.

    What neither options nor the file of choices say is asked, if somebody sits at the terminal.

    Args:
        source: MJCF or URDF of a quadruped with three hinges a leg.
        choices: TOML file with motors, gears, gains and the rest; options override it. From Python also
            ``sl.RobotChoices``.
        name: of the robot; by default the file's name.
        abad_motor: motor file, name of a library motor, or ROBOT:JOINT such as bp2:abad.
        hip_motor: the same for the hips.
        knee_motor: the same for the knees.
        abad_gear: gear ratio, motor speed over joint speed.
        hip_gear: the same for the hips.
        knee_gear: the same for the knees.
        bus_voltage: [V].
        foot_radius: [m], where the source has no foot sphere.
        output: folder in which the robot's folder is put; in ./robots robots are found by name.

    Raises:
        RobotModelError: the source or the file of choices cannot be used, or the robot's folder exists.
        SprintlabError: a choice is refused, a motor cannot be found, or the files cannot be written.
    """
    from sprintlab.robots import importing

    check_kind("choices", choices, importing.RobotChoices | str | Path | None)
    read = importing.read_source(Path(source), foot_radius or 0.02)  # a bad file is refused before asking
    if not isinstance(choices, importing.RobotChoices):
        given: dict[str, Any] = {} if choices is None else importing.read_choices(Path(choices))
        options = {"name": name, "bus_voltage": bus_voltage, "foot_radius": foot_radius}
        given = {"name": read.path.stem, **given, **{key: v for key, v in options.items() if v is not None}}
        motors: dict[str, Any] = dict(zip(JOINTS, (abad_motor, hip_motor, knee_motor), strict=True))
        gears: dict[str, Any] = dict(zip(JOINTS, (abad_gear, hip_gear, knee_gear), strict=True))
        given["joints"] = tables = {joint: dict(given.get("joints", {}).get(joint, {})) for joint in JOINTS}
        open_choices = [] if "bus_voltage" in given else [(given, "bus_voltage", "--bus-voltage")]
        for joint, made in tables.items():
            for field, value in (("motor", motors[joint]), ("gear_ratio", gears[joint])):
                if value is not None:
                    made[field] = value
                elif field not in made:
                    open_choices.append((made, field, f"--{joint}-{field.partition('_')[0]}"))
        _ask(open_choices)
        choices = importing.make_choices(given, str(choices))
    made = importing.import_robot(read, choices, Path(output))
    checks = [asdict(check) for check in made.checks]
    rows = ((check.what, check.outcome, "" if check.good else "look at this") for check in made.checks)
    shown = [
        table(f"Robot {made.robot.name} from {read.path}", "check", "outcome", "", rows=rows),
        f"written: {made.folder}/ (parameters.toml, joints.json)",
        f"next: sprintlab robot show {made.folder}; sprintlab train {made.folder}",
    ]
    numbers = {"folder": str(made.folder), "robot": made.robot.name, "checks": checks}
    return RobotImport(numbers=numbers, shown=shown, folder=made.folder, robot=made.robot)


def _ask(open_choices: Sequence[tuple[dict[str, Any], str, str]]) -> None:
    """Fill in, from the terminal, what neither options nor the file say: table, key, option of each.

    Raises:
        RobotModelError: there is no terminal to answer; names all options to give.
    """
    if open_choices and not sys.stdin.isatty():
        options = ", ".join(option for *_, option in open_choices)
        raise RobotModelError(f"not given: {options}; a file of --choices can hold them, too")
    from rich.prompt import FloatPrompt, Prompt

    for made, key, option in open_choices:
        prompt: Any = Prompt if key == "motor" else FloatPrompt
        what = "bus voltage [V]" if key == "bus_voltage" else option.removeprefix("--").replace("-", " ")
        made[key] = prompt.ask(what, console=PlainConsole(stderr=True))
