"""Robots of one's own: from an MJCF or URDF to a robot's folder."""

from sprintlab.robots.importing.checks import compare_models as compare_models
from sprintlab.robots.importing.choices import JointChoice as JointChoice
from sprintlab.robots.importing.choices import RobotChoices as RobotChoices
from sprintlab.robots.importing.choices import make_choices as make_choices
from sprintlab.robots.importing.choices import read_choices as read_choices
from sprintlab.robots.importing.fit import fit_robot as fit_robot
from sprintlab.robots.importing.source import read_source as read_source
from sprintlab.robots.importing.write import import_robot as import_robot
