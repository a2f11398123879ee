"""From a robot's parameter table to its description."""

from __future__ import annotations

import math
from importlib import resources
from pathlib import Path

import numpy as np

from sprintlab.core.errors import InvalidValueError, RobotModelError
from sprintlab.motors import Gear, PmsmParameters, stack_motors
from sprintlab.robots.description import (
    JOINTS_PER_LEG,
    FloatArray,
    KneeSpring,
    Link,
    Mechanics,
    RobotDescription,
    SoftStop,
)
from sprintlab.robots.table import ParameterRow, ParameterTable, read_table

LEG_NAMES = ("FL", "FR", "RL", "RR")
_WINDING_OF_JOINT = {"abad": "motor.abad", "hip": "motor.hip_knee", "knee": "motor.hip_knee"}
_TABLE_FILE = "parameters.toml"


def robot_names() -> tuple[str, ...]:
    """Names of the robots that come with the package, sorted."""
    folders = resources.files("sprintlab.robots").iterdir()
    return tuple(sorted(folder.name for folder in folders if folder.joinpath(_TABLE_FILE).is_file()))


def load_robot(name: str) -> RobotDescription:
    """Load a robot that comes with the package.

    Raises:
        RobotModelError: no robot has this name (the message lists those that exist), or its table is broken.
    """
    return load_robot_file(_table_path(name))


def load_robot_file(path: str | Path) -> RobotDescription:
    """Load a robot from a parameter table of one's own.

    Raises:
        RobotModelError: the file cannot be read, or a quantity is missing, unknown or impossible.
    """
    table = read_table(path)
    try:
        return _describe(table)
    except InvalidValueError as error:
        raise RobotModelError(f"robot table {path}: {error}") from error


def parameter_table(name: str) -> list[ParameterRow]:
    """Every number of a robot with unit, uncertainty and basis; numbers that follow from others come last.

    Raises:
        RobotModelError: as ``load_robot``.
    """
    robot = load_robot(name)
    return [*read_table(_table_path(name)).rows.values(), *_derived_rows(robot)]


def _table_path(name: str) -> Path:
    if name not in robot_names():
        raise RobotModelError(f"robot {name!r} is unknown; known robots: {', '.join(robot_names())}")
    return Path(str(resources.files("sprintlab.robots") / name / _TABLE_FILE))


def _describe(table: ParameterTable) -> RobotDescription:
    mechanics = _mechanics(table)
    pose = _per_joint(table, "default_angle")
    foot_radius = table.number("foot.radius")
    return RobotDescription(
        name=table.name,
        leg_names=LEG_NAMES,
        joint_names=tuple(f"{leg}_{joint}" for leg in LEG_NAMES for joint in JOINTS_PER_LEG),
        spring_joint_names=tuple(f"{leg}_spring" for leg in LEG_NAMES),
        default_pose=pose,
        action_scale=_per_joint(table, "action_scale"),
        stiffness=_per_joint(table, "stiffness"),
        damping=_per_joint(table, "damping"),
        position_limits=_position_limits(table),
        viscous_friction=_per_joint(table, "viscous_friction"),
        dry_friction=_per_joint(table, "dry_friction"),
        motors=_motors(table),
        gear=_gear(table),
        bus_voltage=table.number("body.bus_voltage"),
        soft_stop=SoftStop(**_scalars(table, "soft_stop", ("zone", "stiffness", "damping"))),
        base_height_target=table.number("body.base_height_target"),
        standing_height=_leg_height(mechanics, pose[:3]) + foot_radius,
        foot_radius=foot_radius,
        foot_friction=table.number("foot.friction"),
        total_mass=table.number("body.total_mass"),
        mechanics=mechanics,
    )


def _scalars(table: ParameterTable, section: str, names: tuple[str, ...]) -> dict[str, float]:
    return {name: table.number(f"{section}.{name}") for name in names}


def _per_joint(table: ParameterTable, field: str) -> FloatArray:
    """One value a joint type, repeated for the four legs: shape ``(12,)``."""
    values = [table.number(f"joint.{joint}.{field}") for joint in JOINTS_PER_LEG]
    return np.tile(np.array(values), len(LEG_NAMES))


def _position_limits(table: ParameterTable) -> FloatArray:
    """Limits of all joints ``(12, 2)``; the abduction range must be its own mirror image."""
    ranges = {joint: table.vector(f"joint.{joint}.range") for joint in JOINTS_PER_LEG}
    if ranges["abad"][0] != -ranges["abad"][1]:
        raise InvalidValueError("joint.abad.range", ranges["abad"], "must be symmetric: left mirrors right")
    for joint, (low, high) in ranges.items():
        if low >= high:
            raise InvalidValueError(
                f"joint.{joint}.range", (low, high), "must be [lower, upper], lower first"
            )
    return np.tile(np.array([ranges[joint] for joint in JOINTS_PER_LEG]), (len(LEG_NAMES), 1))


def _motors(table: ParameterTable) -> PmsmParameters:
    motors = [_motor(table, _WINDING_OF_JOINT[joint]) for _ in LEG_NAMES for joint in JOINTS_PER_LEG]
    return stack_motors(motors)


def _motor(table: ParameterTable, winding: str) -> PmsmParameters:
    pole_pairs = table.number("motor.pole_pairs")
    if pole_pairs != int(pole_pairs):
        raise InvalidValueError("motor.pole_pairs", pole_pairs, "must be a whole number")
    own = ("stator_resistance", "q_axis_inductance", "peak_torque", "rotor_inertia")
    shared = _scalars(table, "motor", ("flux_linkage", "saturation"))
    return PmsmParameters(pole_pairs=int(pole_pairs), **shared, **_scalars(table, winding, own))


def _gear(table: ParameterTable) -> Gear:
    joints = len(LEG_NAMES) * len(JOINTS_PER_LEG)
    return Gear(
        ratio=np.full(joints, table.number("motor.gear_ratio")),
        efficiency=np.full(joints, table.number("motor.gear_efficiency")),
    )


def _link(table: ParameterTable, section: str) -> Link:
    return Link(
        mass=table.number(f"{section}.mass"),
        center_of_mass=table.vector(f"{section}.center_of_mass"),
        inertia=table.vector(f"{section}.inertia"),
    )


def _mechanics(table: ParameterTable) -> Mechanics:
    """The trunk gets the mass that the four legs leave of the total."""
    carrier = Link(mass=table.number("knee_carrier.mass"), inertia=table.vector("knee_carrier.inertia"))
    links = {
        "abad": _link(table, "abad_link"),
        "thigh": _link(table, "thigh"),
        "shank": _link(table, "shank"),
    }
    foot_mass = table.number("foot.mass")
    leg_mass = sum(link.mass for link in (*links.values(), carrier)) + foot_mass
    trunk_mass = table.number("body.total_mass") - len(LEG_NAMES) * leg_mass
    if trunk_mass <= 0:
        raise InvalidValueError(
            "body.total_mass", table.number("body.total_mass"), "must exceed the legs' mass"
        )
    return Mechanics(
        trunk=Link(mass=trunk_mass, inertia=table.vector("trunk.inertia")),
        trunk_half_size=table.vector("trunk.half_size"),
        hip_x=table.number("trunk.hip_x"),
        hip_y=table.number("trunk.hip_y"),
        abad_offset=table.number("abad_link.offset_y"),
        thigh_length=table.number("thigh.length"),
        thigh_radius=table.number("thigh.collision_radius"),
        knee_carrier=carrier,
        shank_length=table.number("shank.length"),
        shank_radius=table.number("shank.collision_radius"),
        foot_mass=foot_mass,
        knee_spring=_knee_spring(table),
        **links,
    )


def _knee_spring(table: ParameterTable) -> KneeSpring:
    scalars = _scalars(table, "knee_spring", ("stiffness", "damping", "rest_angle"))
    return KneeSpring(range=table.vector("knee_spring.range"), **scalars)


def _leg_height(mechanics: Mechanics, pose: FloatArray) -> float:
    """Height of the trunk's middle over the foot sphere's, joints (abad, hip, knee) at ``pose``."""
    abad, hip, knee = (float(angle) for angle in pose)
    in_plane = mechanics.thigh_length * math.cos(hip) + mechanics.shank_length * math.cos(hip + knee)
    return in_plane * math.cos(abad) - mechanics.abad_offset * math.sin(abad)


def _derived_rows(robot: RobotDescription) -> list[ParameterRow]:
    torque = np.asarray(robot.motors.peak_torque) * np.asarray(robot.gear.ratio)
    rows = (
        ("trunk.mass", robot.mechanics.trunk.mass, "kg", "total mass less four legs"),
        ("body.standing_height", robot.standing_height, "m", "leg geometry in the default pose, unloaded"),
        ("joint.abad.armature", float(robot.armature[0]), "kg m^2", "rotor inertia x gear ratio^2"),
        ("joint.hip.armature", float(robot.armature[1]), "kg m^2", "rotor inertia x gear ratio^2"),
        ("joint.abad.peak_torque", float(torque[0]), "N m", "motor x gear, before saturation and efficiency"),
        ("joint.hip.peak_torque", float(torque[1]), "N m", "motor x gear, before saturation and efficiency"),
    )
    return [
        ParameterRow(quantity=quantity, value=value, unit=unit, uncertainty="derived", basis=basis)
        for quantity, value, unit, basis in rows
    ]
