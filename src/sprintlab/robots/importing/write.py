"""``import_robot``: from a model file and a few choices to a robot's folder."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from sprintlab.core.errors import RobotModelError
from sprintlab.core.files import atomic_directory, atomic_write_json, atomic_write_text
from sprintlab.robots.description import RobotDescription
from sprintlab.robots.importing.checks import Check, run_checks
from sprintlab.robots.importing.choices import RobotChoices
from sprintlab.robots.importing.fit import fit_robot
from sprintlab.robots.importing.source import SourceRobot, read_source
from sprintlab.robots.importing.table import robot_table, table_text
from sprintlab.robots.loader import TABLE_FILE, load_robot_file
from sprintlab.robots.model import ModelOptions, build_model

MAP_FILE = "joints.json"


@dataclass(frozen=True, kw_only=True)
class ImportedRobot:
    """What an import made."""

    folder: Path  # with ``parameters.toml`` and ``joints.json``
    robot: RobotDescription  # as it is read back from there
    checks: tuple[Check, ...]  # comparisons with the source


def import_robot(source: Path | SourceRobot, choices: RobotChoices, output: Path) -> ImportedRobot:
    """Write the folder of a robot from an MJCF or URDF; nothing is left behind if anything is refused.

    ``source`` is a model file, or what ``read_source`` made of it.
    """
    folder = output / choices.name
    if os.path.lexists(folder):
        raise RobotModelError(f"{folder} exists: choose another name, or remove it")
    source = read_source(source, choices.foot_radius)
    fitted, name = fit_robot(source), source.path.name
    table = robot_table(fitted, choices, name)
    with atomic_directory(folder) as draft:
        atomic_write_text(draft / TABLE_FILE, table_text(choices.name, table, name))
        robot = load_robot_file(draft / TABLE_FILE)
        build_model(robot, ModelOptions(collisions="full"))
        maps: Mapping[str, object] = {name: asdict(item) for name, item in fitted.maps.items()}
        atomic_write_json(draft / MAP_FILE, maps)
        checks = run_checks(source, fitted, choices, robot)
    return ImportedRobot(folder=folder, robot=robot, checks=checks)
