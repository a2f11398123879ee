"""``sprintlab robot new``: a robot's folder from an MJCF or URDF."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro

from sprintlab.api.importing import import_robot
from sprintlab.cli.output import show, stderr_console
from sprintlab.core.errors import RobotModelError

JOINTS = ("abad", "hip", "knee")


@dataclass(frozen=True, kw_only=True)
class RobotNew:
    """Make a robot from an MJCF or URDF: its parameter table and a training configuration.

    What neither options nor the file of choices say is asked, if somebody sits at the terminal.

    Attributes:
        source: MJCF or URDF of a quadruped with three hinges a leg.
        name: of the robot; by default the file's name.
        choices: TOML file with motors, gears, gains and the rest; options override it.
        abad_motor: motor file, name of a library motor, or ROBOT:JOINT such as bp2:abad.
        hip_motor: the same for the hips.
        knee_motor: the same for the knees.
        abad_gear: gear ratio, motor speed over joint speed.
        hip_gear: the same for the hips.
        knee_gear: the same for the knees.
        bus_voltage: [V].
        foot_radius: [m], where the source has no foot sphere.
        output: folder in which the robot's folder is put; robots are found there by name.
        json: print JSON only.
    """

    source: tyro.conf.Positional[Path]
    name: str | None = None
    choices: Path | None = None
    abad_motor: str | None = None
    hip_motor: str | None = None
    knee_motor: str | None = None
    abad_gear: float | None = None
    hip_gear: float | None = None
    knee_gear: float | None = None
    bus_voltage: float | None = None
    foot_radius: float | None = None
    output: Path = Path("robots")
    json: bool = False

    def run(self) -> int:
        """Write the folder; raises ``SprintlabError`` for a source or a choice that cannot be used."""
        from sprintlab.robots.importing import make_choices, read_source

        source = read_source(self.source, self.foot_radius or 0.02)  # refuse a bad file before asking
        choices = make_choices(self._all_choices(), str(self.choices))
        show(import_robot(source, choices, self.output), self)
        return 0

    def _all_choices(self) -> dict[str, Any]:
        """Options over the file of choices over answers at the terminal."""
        from sprintlab.robots.importing import read_choices

        given = read_choices(self.choices) if self.choices is not None else {}
        tables = {joint: dict(given.get("joints", {}).get(joint, {})) for joint in JOINTS}
        chosen = {key: value for key, value in given.items() if key != "joints"}
        options = {"name": self.name, "bus_voltage": self.bus_voltage, "foot_radius": self.foot_radius}
        chosen |= {key: value for key, value in options.items() if value is not None}
        chosen.setdefault("name", self.source.stem)
        open_choices = [] if "bus_voltage" in chosen else [(chosen, "bus_voltage", "--bus-voltage")]
        for joint, table in tables.items():
            for field, option in (("motor", "motor"), ("gear_ratio", "gear")):
                value = getattr(self, f"{joint}_{option}")
                if value is not None:
                    table[field] = value
                elif field not in table:
                    open_choices.append((table, field, f"--{joint}-{option}"))
        ask(open_choices)
        return {**chosen, "joints": tables}


def ask(open_choices: Sequence[tuple[dict[str, Any], str, str]]) -> None:
    """Fill in, from the terminal, what neither options nor the file say: table, key, option of each.

    Raises:
        RobotModelError: there is no terminal to answer; names all options to give.
    """
    if open_choices and not sys.stdin.isatty():
        options = ", ".join(option for *_, option in open_choices)
        raise RobotModelError(f"not given: {options}; a file of --choices can hold them, too")
    from rich.prompt import FloatPrompt, Prompt

    for table, key, option in open_choices:
        prompt: Any = Prompt if key == "motor" else FloatPrompt
        what = "bus voltage [V]" if key == "bus_voltage" else option.removeprefix("--").replace("-", " ")
        table[key] = prompt.ask(what, console=stderr_console())
