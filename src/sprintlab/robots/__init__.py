"""Robots: numbers with their sources, and the MuJoCo models compiled from them."""

from sprintlab.robots.air import AIR_DENSITY, DRAG_AREA, DRAG_AREA_BAND, air_drag
from sprintlab.robots.description import (
    KneeSpring,
    Link,
    Mechanics,
    RobotDescription,
    SoftStop,
    joint_kind,
    neighbouring_legs,
    robot_fingerprint,
)
from sprintlab.robots.foot import (
    NOMINAL_FOOT,
    RESTITUTION_BAND,
    STIFFNESS_BAND,
    ContactLaw,
    DropOutcome,
    FootContact,
    contact_law,
    drop_outcome,
    effective_leg_mass,
    friction_ratio,
    pair_parameters,
    set_foot_contact,
    set_friction,
)
from sprintlab.robots.loader import load_robot, load_robot_file, parameter_table, robot_names
from sprintlab.robots.model import ModelOptions, build_model, leg_signs, robot_spec, shank_with_foot
from sprintlab.robots.stops import soft_stop_torque
from sprintlab.robots.table import ParameterRow

__all__ = [
    "AIR_DENSITY",
    "DRAG_AREA",
    "DRAG_AREA_BAND",
    "NOMINAL_FOOT",
    "RESTITUTION_BAND",
    "STIFFNESS_BAND",
    "ContactLaw",
    "DropOutcome",
    "FootContact",
    "KneeSpring",
    "Link",
    "Mechanics",
    "ModelOptions",
    "ParameterRow",
    "RobotDescription",
    "SoftStop",
    "air_drag",
    "build_model",
    "contact_law",
    "drop_outcome",
    "effective_leg_mass",
    "friction_ratio",
    "joint_kind",
    "leg_signs",
    "load_robot",
    "load_robot_file",
    "neighbouring_legs",
    "pair_parameters",
    "parameter_table",
    "robot_fingerprint",
    "robot_names",
    "robot_spec",
    "set_foot_contact",
    "set_friction",
    "shank_with_foot",
    "soft_stop_torque",
]
