"""Robots: numbers with their sources, and the MuJoCo models compiled from them."""

from sprintlab.robots.description import (
    KneeSpring,
    Link,
    Mechanics,
    RobotDescription,
    SoftStop,
    robot_fingerprint,
)
from sprintlab.robots.loader import load_robot, load_robot_file, parameter_table, robot_names
from sprintlab.robots.model import ModelOptions, build_model, robot_spec
from sprintlab.robots.stops import soft_stop_torque
from sprintlab.robots.table import ParameterRow

__all__ = [
    "KneeSpring",
    "Link",
    "Mechanics",
    "ModelOptions",
    "ParameterRow",
    "RobotDescription",
    "SoftStop",
    "build_model",
    "load_robot",
    "load_robot_file",
    "parameter_table",
    "robot_fingerprint",
    "robot_names",
    "robot_spec",
    "soft_stop_torque",
]
