"""From a robot's parameter table to its description."""

from __future__ import annotations

import math
import os
from importlib import resources
from pathlib import Path

import numpy as np

from sprintlab.core.arguments import checked
from sprintlab.core.errors import InvalidValueError, RobotModelError
from sprintlab.motors import Battery, Gear, PmsmParameters, stack_motors
from sprintlab.motors.parameters import MOTOR_UNITS
from sprintlab.robots.air import DRAG_AREA
from sprintlab.robots.description import (
    JOINTS_PER_LEG,
    WAIST,
    FloatArray,
    KneeSpring,
    Link,
    Mechanics,
    RobotDescription,
    SoftStop,
    joint_kind,
)
from sprintlab.robots.table import ParameterRow, ParameterTable, read_table

LEG_NAMES = ("FL", "FR", "RL", "RR")
TABLE_FILE = "parameters.toml"
SEARCH_PATH_VARIABLE = "SPRINTLAB_ROBOTS"
DEFAULT_SEARCH_PATH = "robots"
_BP2_MASS = 36.5  # [kg]


def robot_names() -> tuple[str, ...]:
    """Names of the robots that come with the package and of those on the search path, sorted."""
    return tuple(sorted(_known_tables()))


@checked
def load_robot(name: str | Path) -> RobotDescription:
    """Load a robot by its name, or by the path of its folder or table.

    A name is looked up in the package first, then in the folders of the environment variable
    ``SPRINTLAB_ROBOTS`` (default: ``robots`` in the working directory), where each robot has a folder of its
    name with a ``parameters.toml``. What holds a path separator or ends in ``.toml`` is a path.

    Raises:
        RobotModelError: no robot has this name (the message lists those that exist), or its table is broken.
    """
    return load_robot_file(robot_table_path(name))


def load_robot_file(path: str | Path) -> RobotDescription:
    """Load a robot from a parameter table of one's own.

    Raises:
        RobotModelError: the file cannot be read, or a quantity is missing, unknown or impossible.
    """
    table = read_table(path)
    try:
        return describe_table(table)
    except InvalidValueError as error:
        raise RobotModelError(f"robot table {path}: {error}") from error


def parameter_table(name: str | Path) -> list[ParameterRow]:
    """Every number of a robot with unit, uncertainty and basis; numbers that follow from others come last.

    Raises:
        RobotModelError: as ``load_robot``.
    """
    path = robot_table_path(name)
    return [*read_table(path).rows.values(), *_derived_rows(load_robot_file(path))]


def robot_table_path(name: str | Path) -> Path:
    """The parameter table that a robot's name or path stands for; see ``load_robot``.

    Raises:
        RobotModelError: a name that no robot has.
    """
    path = Path(name)
    if str(name).endswith(".toml"):
        return path
    if isinstance(name, Path) or any(sign in name for sign in (os.sep, os.altsep or os.sep)):
        return path / TABLE_FILE
    known = _known_tables()
    if name not in known:
        raise RobotModelError(f"robot {name!r} is unknown; known robots: {', '.join(sorted(known))}")
    return known[name]


def search_path() -> list[Path]:
    """Folders in which robots of one's own are looked for."""
    text = os.environ.get(SEARCH_PATH_VARIABLE, DEFAULT_SEARCH_PATH)
    return [Path(folder) for folder in text.split(os.pathsep) if folder]


def _known_tables() -> dict[str, Path]:
    """Table of every robot by name; one that comes with the package hides others of its name."""
    package = Path(str(resources.files("sprintlab.robots")))
    tables: dict[str, Path] = {}
    for folder in (package, *search_path()):
        for table in sorted(folder.glob(f"*/{TABLE_FILE}")):
            tables.setdefault(table.parent.name, table)
    return tables


def describe_table(table: ParameterTable) -> RobotDescription:
    """The robot that a checked parameter table says."""
    mechanics = _mechanics(table)
    pose = _per_joint(table, "default_angle")
    foot_radius = table.number("foot.radius")
    return RobotDescription(
        name=table.name,
        leg_names=LEG_NAMES,
        joint_names=(
            *(f"{leg}_{joint}" for leg in LEG_NAMES for joint in JOINTS_PER_LEG),
            *((WAIST,) if table.has_waist else ()),
        ),
        spring_joint_names=tuple(f"{leg}_spring" for leg in LEG_NAMES if table.has_knee_spring),
        default_pose=pose,
        action_scale=_per_joint(table, "action_scale"),
        stiffness=_per_joint(table, "stiffness"),
        damping=_per_joint(table, "damping"),
        position_limits=_position_limits(table),
        viscous_friction=_per_joint(table, "viscous_friction"),
        dry_friction=_per_joint(table, "dry_friction"),
        motors=stack_motors([_motor(table, joint) for joint in _kinds(table)]),
        gear=_gear(table),
        bus_voltage=table.number("body.bus_voltage"),
        soft_stop=SoftStop(**_scalars(table, "soft_stop", ("zone", "stiffness", "damping"))),
        base_height_target=table.number("body.base_height_target"),
        standing_height=_leg_height(mechanics, pose[:3]) + foot_radius,
        foot_radius=foot_radius,
        foot_friction=table.number("foot.friction"),
        total_mass=table.number("body.total_mass"),
        mechanics=mechanics,
        drag_area=_drag_area(table),
        battery=_battery(table),
    )


def _drag_area(table: ParameterTable) -> float:
    """As the table says, else that of BP2 scaled with the two thirds of the mass as lengths squared are."""
    if "body.drag_area" in table.rows:
        return table.number("body.drag_area")
    return DRAG_AREA * (table.number("body.total_mass") / _BP2_MASS) ** (2.0 / 3.0)


def _battery(table: ParameterTable) -> Battery:
    """As the table says, else a pack of the default cells whose full voltage is just below the bus's."""
    if not table.has_battery:
        full = Battery().voltage_table[-1]
        return Battery(series_cells=max(1, int(table.number("body.bus_voltage") / full)))
    cells = table.number("battery.series_cells")
    if cells != int(cells):
        raise InvalidValueError("battery.series_cells", cells, "must be a whole number")
    return Battery(
        series_cells=int(cells),
        internal_resistance=table.number("battery.internal_resistance"),
        capacity=table.number("battery.capacity"),
    )


def _scalars(table: ParameterTable, section: str, names: tuple[str, ...]) -> dict[str, float]:
    return {name: table.number(f"{section}.{name}") for name in names}


def _kinds(table: ParameterTable) -> tuple[str, ...]:
    """The kind of each joint in policy order: those of a leg for every leg, then the waist."""
    return JOINTS_PER_LEG * len(LEG_NAMES) + table.joints[len(JOINTS_PER_LEG) :]


def _per_joint(table: ParameterTable, field: str) -> FloatArray:
    """One value per joint in policy order ``(J,)``."""
    return np.array([table.number(f"joint.{joint}.{field}") for joint in _kinds(table)])


def _position_limits(table: ParameterTable) -> FloatArray:
    """Limits of all joints ``(J, 2)``; the abduction range must be its own mirror image."""
    ranges = {joint: table.vector(f"joint.{joint}.range") for joint in table.joints}
    if ranges["abad"][0] != -ranges["abad"][1]:
        raise InvalidValueError("joint.abad.range", ranges["abad"], "must be symmetric: left mirrors right")
    for joint, (low, high) in ranges.items():
        if low >= high:
            raise InvalidValueError(
                f"joint.{joint}.range", (low, high), "must be [lower, upper], lower first"
            )
    return np.array([ranges[joint] for joint in _kinds(table)])


def _motor(table: ParameterTable, joint: str) -> PmsmParameters:
    pole_pairs = table.drive(joint, "pole_pairs")
    number = table.number(pole_pairs)
    if number != int(number):
        raise InvalidValueError(pole_pairs, number, "must be a whole number")
    values = {name: table.number(table.drive(joint, name)) for name in MOTOR_UNITS}
    return PmsmParameters(**values | {"pole_pairs": int(number)})


def _gear(table: ParameterTable) -> Gear:
    def column(field: str) -> FloatArray:
        return np.array([table.number(table.drive(joint, field)) for joint in _kinds(table)])

    return Gear(ratio=column("gear_ratio"), efficiency=column("gear_efficiency"))


def _link(table: ParameterTable, section: str, mass: float | None = None) -> Link:
    return Link(
        mass=table.number(f"{section}.mass") if mass is None else mass,
        center_of_mass=table.optional_vector(f"{section}.center_of_mass") or (0.0, 0.0, 0.0),
        inertia=table.vector(f"{section}.inertia"),
        products_of_inertia=table.optional_vector(f"{section}.products_of_inertia"),
    )


def _mechanics(table: ParameterTable) -> Mechanics:
    """The trunk, or its front half, gets the mass that legs and rear half leave of the total."""
    carrier = _link(table, "knee_carrier") if table.has_knee_spring else None
    links = {
        "abad": _link(table, "abad_link"),
        "thigh": _link(table, "thigh"),
        "shank": _link(table, "shank"),
    }
    foot_mass = table.number("foot.mass")
    leg_mass = sum(link.mass for link in (*links.values(), carrier) if link is not None) + foot_mass
    rear_trunk = _link(table, "rear_trunk") if table.has_waist else None
    trunk_mass = table.number("body.total_mass") - len(LEG_NAMES) * leg_mass
    trunk_mass -= 0.0 if rear_trunk is None else rear_trunk.mass
    if trunk_mass <= 0:
        raise InvalidValueError(
            "body.total_mass", table.number("body.total_mass"), "must exceed the legs' mass"
        )
    return Mechanics(
        trunk=_link(table, "trunk", trunk_mass),
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
        rear_trunk=rear_trunk,
        **links,
    )


def _knee_spring(table: ParameterTable) -> KneeSpring | None:
    if not table.has_knee_spring:
        return None
    scalars = _scalars(table, "knee_spring", ("stiffness", "damping", "rest_angle"))
    return KneeSpring(range=table.vector("knee_spring.range"), **scalars)


def _leg_height(mechanics: Mechanics, pose: FloatArray) -> float:
    """Height of the trunk's middle over the foot sphere's, joints (abad, hip, knee) at ``pose``."""
    abad, hip, knee = (float(angle) for angle in pose)
    in_plane = mechanics.thigh_length * math.cos(hip) + mechanics.shank_length * math.cos(hip + knee)
    return in_plane * math.cos(abad) - mechanics.abad_offset * math.sin(abad)


def _derived_rows(robot: RobotDescription) -> list[ParameterRow]:
    torque = np.asarray(robot.motors.peak_torque) * np.asarray(robot.gear.ratio)
    rows = [
        ("trunk.mass", robot.mechanics.trunk.mass, "kg", "total mass less four legs"),
        ("body.standing_height", robot.standing_height, "m", "leg geometry in the default pose, unloaded"),
    ]
    kinds = [joint_kind(name) for name in robot.joint_names]
    for joint in dict.fromkeys(kinds):
        index = kinds.index(joint)
        inertia, peak = float(robot.armature[index]), float(torque[index])
        rows.append((f"joint.{joint}.armature", inertia, "kg m^2", "rotor inertia x gear ratio^2"))
        basis = "motor x gear, before saturation and efficiency"
        rows.append((f"joint.{joint}.peak_torque", peak, "N m", basis))
    return [
        ParameterRow(quantity=quantity, value=value, unit=unit, uncertainty="derived", basis=basis)
        for quantity, value, unit, basis in rows
    ]
