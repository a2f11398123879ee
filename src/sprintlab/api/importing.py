"""``import_robot``: a robot of one's own, from its MJCF or URDF to a folder that is found by its name."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import RenderableType

from sprintlab.api.tables import Printed, plain_table
from sprintlab.core.arguments import check_kind, checked

if TYPE_CHECKING:
    from sprintlab.robots.description import RobotDescription
    from sprintlab.robots.importing import Check, RobotChoices, SourceRobot


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class RobotImport(Printed):
    """What an import made; prints how the robot compares with the model that it came from."""

    source: Path
    """The MJCF or URDF."""
    folder: Path
    """With ``parameters.toml``, ``joints.json`` and ``train.py``."""
    robot: RobotDescription
    """As it is read back from there."""
    checks: tuple[Check, ...]
    """Comparisons with the source; those that are not ``good`` want a decision."""

    def to_dict(self) -> dict[str, Any]:
        """Folder, name and comparisons."""
        checks = [asdict(check) for check in self.checks]
        return {"folder": str(self.folder), "robot": self.robot.name, "checks": checks}

    def tables(self) -> Iterator[RenderableType]:
        """One row per comparison, where the files are, and what to do next."""
        rows = ((check.what, check.outcome, "" if check.good else "look at this") for check in self.checks)
        yield plain_table(f"Robot {self.robot.name} from {self.source}", "check", "outcome", "", rows=rows)
        yield f"written: {self.folder}/ (parameters.toml, joints.json, train.py)"
        # By its folder: a robot of the package may have the same name, and it comes first.
        yield f"next: sprintlab robot show {self.folder}; python {self.folder}/train.py --help"


@checked
def import_robot(
    source: str | Path | SourceRobot, choices: RobotChoices | str | Path, output: str | Path = "robots"
) -> RobotImport:
    """Make a robot from an MJCF or URDF: its parameter table and a training configuration.

    Args:
        source: MJCF or URDF of a quadruped with three hinges a leg, or what was read of it.
        choices: what it does not say: motors, gears, bus voltage; a TOML file of them, or ``RobotChoices``.
        output: folder in which the robot's folder is put; in ``./robots`` robots are found by name.

    Raises:
        RobotModelError: the source or the file of choices cannot be used, or the robot's folder exists.
        SprintlabError: a choice is refused, a motor cannot be found, or the files cannot be written.
    """
    from sprintlab.robots import importing

    check_kind("source", source, str | Path | importing.SourceRobot)
    check_kind("choices", choices, importing.RobotChoices | str | Path)
    read = source if isinstance(source, importing.SourceRobot) else Path(source)
    path = read if isinstance(read, Path) else read.path
    if not isinstance(choices, importing.RobotChoices):
        given = importing.read_choices(Path(choices))
        choices = importing.make_choices({"name": path.stem, **given}, str(choices))
    made = importing.import_robot(read, choices, Path(output))
    return RobotImport(source=path, folder=made.folder, robot=made.robot, checks=made.checks)
