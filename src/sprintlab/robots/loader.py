"""From a robot's parameter table to its description."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

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
from sprintlab.robots.table import ParameterRow, drive_quantity, has_part, read_table

LEG_NAMES = ("FL", "FR", "RL", "RR")
TABLE_FILE = "parameters.toml"
SEARCH_PATH_VARIABLE = "SPRINTLAB_ROBOTS"
DEFAULT_SEARCH_PATH = "robots"
_BP2_MASS = 36.5  # [kg]

Values = Mapping[str, Any]
"""Numbers and tuples of numbers by quantity."""


def robot_names() -> tuple[str, ...]:
    """Names of the robots that come with the package and of those on the search path, sorted."""
    return tuple(sorted(_known_tables()))


@checked
def load_robot(name: str | Path) -> RobotDescription:
    """Load a robot by its name, or by the path of its folder or table.

    A name is looked up in the package first, then in the folders of the environment variable
    ``SPRINTLAB_ROBOTS`` (default: ``robots`` in the working directory), where each robot has a folder of its
    name with a ``parameters.toml``. What holds a path separator or ends in ``.toml`` is a path.
    """
    return load_robot_file(robot_table_path(name))


def load_robot_file(path: str | Path) -> RobotDescription:
    """Load a robot from a parameter table of one's own."""
    name, rows = read_table(path)
    try:
        return _described(name, {quantity: row.value for quantity, row in rows.items()})
    except InvalidValueError as error:
        raise RobotModelError(f"robot table {path}: {error}") from error


def parameter_table(name: str | Path) -> list[ParameterRow]:
    """Every number of a robot with unit, uncertainty and basis; numbers that follow from others come last."""
    path = robot_table_path(name)
    return [*read_table(path)[1].values(), *_derived_rows(load_robot_file(path))]


def robot_table_path(name: str | Path) -> Path:
    """The parameter table that a robot's name or path stands for; see ``load_robot``.

    Raises:
        RobotModelError: a name that no robot has, or a model file, of which `robot new` makes a robot.
    """
    path = Path(name)
    if path.suffix in (".urdf", ".xml"):
        raise RobotModelError(f"{name} is a model, not a robot's table: sprintlab robot new makes one of it")
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


def _described(name: str, values: Values) -> RobotDescription:
    """The robot of a checked table's values by quantity."""
    waist = (WAIST,) if has_part(values, WAIST) else ()
    kinds = JOINTS_PER_LEG * len(LEG_NAMES) + waist  # kind of each joint in policy order

    def per_joint(field: str) -> FloatArray:
        return np.array([values[f"joint.{joint}.{field}"] for joint in kinds])

    def drives(field: str) -> FloatArray:
        return np.array([values[drive_quantity(values, joint, field)] for joint in kinds])

    mechanics, pose = _mechanics(values), per_joint("default_angle")
    return RobotDescription(
        name=name,
        leg_names=LEG_NAMES,
        joint_names=(*(f"{leg}_{joint}" for leg in LEG_NAMES for joint in JOINTS_PER_LEG), *waist),
        spring_joint_names=tuple(f"{leg}_spring" for leg in LEG_NAMES if mechanics.knee_spring is not None),
        default_pose=pose,
        action_scale=per_joint("action_scale"),
        stiffness=per_joint("stiffness"),
        damping=per_joint("damping"),
        position_limits=_position_limits(values, kinds),
        viscous_friction=per_joint("viscous_friction"),
        dry_friction=per_joint("dry_friction"),
        motors=stack_motors([_motor(values, joint) for joint in kinds]),
        gear=Gear(ratio=drives("gear_ratio"), efficiency=drives("gear_efficiency")),
        bus_voltage=values["body.bus_voltage"],
        soft_stop=SoftStop(
            **{name: values[f"soft_stop.{name}"] for name in ("zone", "stiffness", "damping")}
        ),
        base_height_target=values["body.base_height_target"],
        standing_height=_leg_height(mechanics, pose[:3]) + values["foot.radius"],
        foot_radius=values["foot.radius"],
        foot_friction=values["foot.friction"],
        total_mass=values["body.total_mass"],
        mechanics=mechanics,
        drag_area=values.get("body.drag_area", _scaled_drag_area(values)),
        battery=_battery(values),
    )


def _scaled_drag_area(values: Values) -> float:
    """BP2's, scaled with the two thirds of the mass as lengths squared are [m^2]."""
    return DRAG_AREA * (values["body.total_mass"] / _BP2_MASS) ** (2.0 / 3.0)


def _battery(values: Values) -> Battery:
    """As the table says, else a pack of the default cells whose full voltage is just below the bus's."""
    if not has_part(values, "battery"):
        full = Battery().voltage_table[-1]
        return Battery(series_cells=max(1, int(values["body.bus_voltage"] / full)))
    return Battery(
        series_cells=_whole(values, "battery.series_cells"),
        internal_resistance=values["battery.internal_resistance"],
        capacity=values["battery.capacity"],
    )


def _whole(values: Values, quantity: str) -> int:
    if values[quantity] != int(values[quantity]):
        raise InvalidValueError(quantity, values[quantity], "must be a whole number")
    return int(values[quantity])


def _position_limits(values: Values, kinds: tuple[str, ...]) -> FloatArray:
    """Limits of all joints ``(J, 2)``; the abduction range must be its own mirror image."""
    for joint in dict.fromkeys(kinds):
        quantity = f"joint.{joint}.range"
        low, high = values[quantity]
        if joint == "abad" and low != -high:
            raise InvalidValueError(quantity, (low, high), "must be symmetric: left mirrors right")
        if low >= high:
            raise InvalidValueError(quantity, (low, high), "must be [lower, upper], lower first")
    return np.array([values[f"joint.{joint}.range"] for joint in kinds])


def _motor(values: Values, joint: str) -> PmsmParameters:
    fields = {name: values[drive_quantity(values, joint, name)] for name in MOTOR_UNITS}
    pole_pairs = _whole(values, drive_quantity(values, joint, "pole_pairs"))
    return PmsmParameters(**fields | {"pole_pairs": pole_pairs})


def _link(values: Values, section: str, mass: float | None = None) -> Link:
    return Link(
        mass=values[f"{section}.mass"] if mass is None else mass,
        center_of_mass=values.get(f"{section}.center_of_mass", (0.0, 0.0, 0.0)),
        inertia=values[f"{section}.inertia"],
        products_of_inertia=values.get(f"{section}.products_of_inertia"),
    )


def _mechanics(values: Values) -> Mechanics:
    """The trunk, or its front half, gets the mass that legs and rear half leave of the total."""
    spring, total = has_part(values, "spring"), values["body.total_mass"]
    names = ("abad_link", "thigh", "shank", *(("knee_carrier",) if spring else ()))
    links = {name: _link(values, name) for name in names}
    rear_trunk = _link(values, "rear_trunk") if has_part(values, WAIST) else None
    leg_mass = sum(link.mass for link in links.values()) + values["foot.mass"]
    trunk_mass = total - len(LEG_NAMES) * leg_mass - (0.0 if rear_trunk is None else rear_trunk.mass)
    if trunk_mass <= 0:
        raise InvalidValueError("body.total_mass", total, "must exceed the legs' mass")
    parts = ("stiffness", "damping", "rest_angle", "range")
    return Mechanics(
        trunk=_link(values, "trunk", trunk_mass),
        trunk_half_size=values["trunk.half_size"],
        hip_x=values["trunk.hip_x"],
        hip_y=values["trunk.hip_y"],
        abad=links["abad_link"],
        abad_offset=values["abad_link.offset_y"],
        thigh=links["thigh"],
        thigh_length=values["thigh.length"],
        thigh_radius=values["thigh.collision_radius"],
        knee_carrier=links.get("knee_carrier"),
        shank=links["shank"],
        shank_length=values["shank.length"],
        shank_radius=values["shank.collision_radius"],
        foot_mass=values["foot.mass"],
        knee_spring=KneeSpring(**{part: values[f"knee_spring.{part}"] for part in parts}) if spring else None,
        rear_trunk=rear_trunk,
    )


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
