"""What a model file does not say: motors, gears, bus, gains. Read from options, a TOML file, or asked."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from sprintlab.core.arguments import check_fields
from sprintlab.core.checks import check_range
from sprintlab.core.errors import InvalidValueError, RobotModelError
from sprintlab.core.reading import read_toml
from sprintlab.motors import PmsmParameters, library_motors, load_library_motor, load_motor, single
from sprintlab.motors.voltage import check_bus_voltage
from sprintlab.robots.description import JOINTS_PER_LEG
from sprintlab.robots.loader import load_robot
from sprintlab.robots.table import KINDS


@dataclass(frozen=True, kw_only=True)
class JointChoice:
    """Drive and controller of one joint type; a field that is None is derived."""

    # a motor file (TOML), the name of a library motor, or ``ROBOT:JOINT`` for the motor of a known robot,
    # e.g. ``bp2:hip``
    motor: str
    gear_ratio: float  # motor speed over joint speed
    gear_efficiency: float = 0.95  # joint torque over ratio times motor torque
    # proportional gain [N m/rad]; by default the peak torque at 0.45 rad of error
    stiffness: float | None = None
    damping: float | None = None  # derivative gain [N m s/rad]; by default 0.03 s times the stiffness
    default_angle: float | None = None  # at zero action [rad]
    action_scale: float | None = None  # joint target per unit of action [rad]
    viscous_friction: float | None = None  # [N m s/rad]; by default the source's
    dry_friction: float | None = None  # [N m]; by default the source's

    def __post_init__(self) -> None:
        check_fields(self)
        check_range("gear_ratio", self.gear_ratio, 1.0, 500.0)
        check_range("gear_efficiency", self.gear_efficiency, 0.01, 1.0)
        for name in ("stiffness", "damping", "action_scale", "viscous_friction", "dry_friction"):
            _check_given(name, getattr(self, name), name)


@dataclass(frozen=True, kw_only=True)
class RobotChoices:
    """Everything about a robot that its model file does not say."""

    name: str  # name of the robot; letters, digits, ``-`` and ``_``
    bus_voltage: float  # [V]
    # one ``JointChoice`` for each of abad, hip and knee
    joints: Mapping[str, JointChoice] = field(default_factory=dict)
    foot_radius: float | None = None  # [m], where the source has no foot sphere
    foot_friction: float = 0.8  # sliding friction coefficient of a foot
    # trunk height to run at [m]; by default 0.92 of the standing height
    base_height_target: float | None = None

    def __post_init__(self) -> None:
        check_fields(self)
        if not self.name or not self.name.replace("-", "").replace("_", "").isalnum():
            raise InvalidValueError("name", self.name, "letters, digits, - and _")
        check_bus_voltage(self.bus_voltage)
        _check_given("foot_friction", self.foot_friction, "friction")
        _check_given("foot_radius", self.foot_radius, "radius")
        _check_given("base_height_target", self.base_height_target, "base_height_target")
        if set(self.joints) != set(JOINTS_PER_LEG):
            raise InvalidValueError("joints", sorted(self.joints), "must be " + ", ".join(JOINTS_PER_LEG))


def _check_given(name: str, value: float | None, quantity: str) -> None:
    """Refuse a number that no robot's table may hold for a quantity; ``None`` is derived."""
    if value is not None:
        kind = KINDS[quantity]
        check_range(name, value, kind.low, kind.high, kind.unit)


def read_choices(path: Path) -> dict[str, Any]:
    """A TOML file with the fields of ``RobotChoices``, and a table ``[joint.abad]``, ... for each joint type.

    A motor file named in it is looked for beside it first, then in the working directory.
    """
    document = read_toml(path, what="choices", error=RobotModelError)
    joints = document.pop("joint", {})
    _check_names(path, document, {item.name for item in fields(RobotChoices)} - {"joints"})
    _check_names(path, joints, set(JOINTS_PER_LEG), "joint.")
    for joint, table in joints.items():
        _check_names(path, table, {item.name for item in fields(JointChoice)}, f"joint.{joint}.")
        beside = path.parent / str(table.get("motor", ""))
        if beside.suffix == ".toml" and os.path.isfile(beside):  # Path.is_file fails on long names
            table["motor"] = str(beside)
    return {**document, "joints": joints}


def make_choices(given: Mapping[str, Any], origin: str) -> RobotChoices:
    """The choices that a table of ``read_choices`` holds; messages name their ``origin``."""
    try:
        tables = {joint: JointChoice(**table) for joint, table in given.get("joints", {}).items()}
        return RobotChoices(**{**given, "joints": tables})
    except TypeError as error:
        raise InvalidValueError("choices", origin, f"a field is missing or unknown: {error}") from error


def _check_names(path: Path, table: Any, known: set[str], prefix: str = "") -> None:
    if not isinstance(table, dict):
        raise RobotModelError(f"{path}: {prefix.rstrip('.')} must be a table")
    for name in table:
        if name not in known:
            choices = ", ".join(sorted(known))
            raise RobotModelError(f"{path}: unknown field {prefix}{name}; choose among {choices}")


def find_motor(reference: str) -> PmsmParameters:
    """The motor of a file, of the library, or of a robot's joint ``ROBOT:JOINT``; one number a field."""
    if reference in library_motors():
        return load_library_motor(reference).motor
    robot_name, colon, joint = reference.rpartition(":")
    if not reference.endswith(".toml") and colon:
        if joint not in JOINTS_PER_LEG:
            raise InvalidValueError(
                "motor", reference, "ROBOT:JOINT with a joint of " + ", ".join(JOINTS_PER_LEG)
            )
        motors, index = load_robot(robot_name).motors, JOINTS_PER_LEG.index(joint)
    elif reference.endswith(".toml") or os.path.isfile(reference):
        motors, index = load_motor(reference), 0
    else:
        raise InvalidValueError(
            "motor",
            reference,
            f"a motor file (.toml), ROBOT:JOINT such as bp2:hip, or one of {', '.join(library_motors())}",
        )
    if not colon and any(np.size(getattr(motors, item.name)) > 1 for item in fields(motors)):
        raise InvalidValueError("motor", reference, "must hold one motor, one number a field")
    return single(motors, index)
