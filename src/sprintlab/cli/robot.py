"""``sprintlab robot``: the robots and where their numbers come from."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import tyro

from sprintlab.cli.build import group
from sprintlab.cli.output import plain_table, print_json, stdout_console
from sprintlab.cli.robot_new import RobotNew
from sprintlab.core.errors import printable


@dataclass(frozen=True, kw_only=True)
class RobotShow:
    """Print every number of a robot with unit, uncertainty and basis.

    Attributes:
        name: the robot, e.g. bp2, or the path of its folder or table.
        json: print JSON only.
    """

    name: tyro.conf.Positional[str] = "bp2"
    json: bool = False

    def run(self) -> int:
        """Print the table; raises ``RobotModelError`` for an unknown robot."""
        from sprintlab.robots import parameter_table

        rows = parameter_table(self.name)
        if self.json:
            print_json([asdict(row) for row in rows])
            return 0
        columns = ("quantity", "value", "unit", "uncertainty", "basis")
        cells = ((row.quantity, value_text(row.value), row.unit, row.uncertainty, row.basis) for row in rows)
        stdout_console().print(plain_table(f"Robot {self.name}", *columns, rows=cells))
        return 0


@dataclass(frozen=True, kw_only=True)
class RobotList:
    """List the robots that come with the package, and those in ./robots.

    Attributes:
        json: print JSON only.
    """

    json: bool = False

    def run(self) -> int:
        """Print one name a line."""
        from sprintlab.robots import robot_names

        if self.json:
            print_json(list(robot_names()))
        else:
            print("\n".join(map(printable, robot_names())))
        return 0


Robot = group(
    "Robots and where their numbers come from.",
    {"show": RobotShow, "new": RobotNew, "list": RobotList},
)


def value_text(value: Any) -> str:
    """A number or a tuple of numbers with at most five significant digits."""
    if isinstance(value, tuple | list):
        return ", ".join(value_text(item) for item in value)
    return f"{value:.5g}" if isinstance(value, int | float) else str(value)
