"""Robots of one's own: from an MJCF or URDF to a robot's folder."""

from sprintlab.robots.importing.checks import Check, compare_models
from sprintlab.robots.importing.choices import JointChoice, RobotChoices, find_motor, read_choices
from sprintlab.robots.importing.fit import FittedRobot, fit_robot
from sprintlab.robots.importing.source import SourceRobot, read_source
from sprintlab.robots.importing.write import ImportedRobot, import_robot, training_text

__all__ = [
    "Check",
    "FittedRobot",
    "ImportedRobot",
    "JointChoice",
    "RobotChoices",
    "SourceRobot",
    "compare_models",
    "find_motor",
    "fit_robot",
    "import_robot",
    "read_choices",
    "read_source",
    "training_text",
]
