"""Motors of a robot's joints, found by the joints' names, whatever their order and naming convention."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from sprintlab.core.array_types import FloatArray
from sprintlab.core.errors import InvalidValueError
from sprintlab.motors import Gear, PmsmParameters
from sprintlab.robots.description import JOINTS_PER_LEG, RobotDescription
from sprintlab.robots.loader import load_robot

CONVENTIONS = (
    JOINTS_PER_LEG,
    ("hip", "thigh", "calf"),  # Unitree, MuJoCo Menagerie, Isaac Lab, mjlab
    ("haa", "hfe", "kfe"),  # ANYmal, Solo
    ("hx", "hy", "kn"),  # Spot
)
"""Words for a leg's abduction, hip and knee joint; "hip" means abduction in one and flexion in another."""

_LEGS = {"lf": "FL", "rf": "FR", "lh": "RL", "rh": "RR", "hl": "RL", "hr": "RR"}


@dataclass(frozen=True, kw_only=True)
class JointMotors:
    """Motors by the names of the joints that they drive; without names one motor drives every joint."""

    names: tuple[str, ...] = ()  # One per motor, ``(n,)``; empty for a single motor
    motor: PmsmParameters  # Motor side, SI; numbers, or arrays ``(n,)``
    gear: Gear  # Likewise
    bus_voltage: float  # [V]

    def ordered(self, names: Sequence[str]) -> JointMotors:
        """The motors of these joints, in this order."""
        if not self.names:
            check_unique(names)
            return self
        chosen = match_joints(names, self.names)
        return replace(
            self,
            names=tuple(names),
            motor=_chosen(self.motor, chosen),
            gear=_chosen(self.gear, chosen),
        )

    def parameters(self, names: Sequence[str]) -> dict[str, FloatArray]:
        """Every number of these joints' motors, each ``(joints,)``: for simulators that keep them as arrays.

        Named as the fields of ``PmsmParameters``, and ``gear_ratio``, ``gear_efficiency``, ``bus_voltage``.
        """
        found = self.ordered(names)
        values = {item.name: getattr(found.motor, item.name) for item in fields(found.motor)}
        values |= {"gear_ratio": found.gear.ratio, "gear_efficiency": found.gear.efficiency}
        values["bus_voltage"] = found.bus_voltage
        return {
            name: np.array(np.broadcast_to(value, len(names)), dtype=float) for name, value in values.items()
        }


def robot_motors(robot: RobotDescription | str) -> JointMotors:
    """The motors of a robot, or of a robot's name, one per joint."""
    if isinstance(robot, str):
        robot = load_robot(robot)
    return JointMotors(
        names=robot.joint_names, motor=robot.motors, gear=robot.gear, bus_voltage=float(robot.bus_voltage)
    )


def match_joints(names: Sequence[str], joints: Sequence[str]) -> list[int]:
    """Index among a robot's ``joints`` of each name: equal, or equal under one of ``CONVENTIONS``.

    ``FL_calf_joint``, ``robot/fl_calf`` and ``LF_KFE`` all are ``FL_knee``. The names are in any order, for
    any number of the robot's joints.
    """
    check_unique(names)
    places = {joint: place for place, joint in enumerate(joints)}
    if all(name in places for name in names):
        return [places[name] for name in names]
    readings = (_read(names, convention, places) for convention in CONVENTIONS)
    found = {tuple(reading) for reading in readings if reading is not None}
    if len(found) == 1:
        return list(found.pop())
    allowed = f"{_listed(joints)}, or one of their other names ({'; '.join(map('/'.join, CONVENTIONS))})"
    if found:
        allowed = "enough names to tell the convention: a hip joint alone is an abduction or a flexion joint"
    raise InvalidValueError("joint_names", _listed(names), allowed)


def check_unique(names: Iterable[str]) -> None:
    """Refuse repeated names. Raises ``InvalidValueError``."""
    if repeated := [name for name, count in Counter(names).items() if count > 1]:
        raise InvalidValueError("joint_names", _listed(repeated), "every name once")


def _listed(names: Iterable[str]) -> str:
    return ", ".join(names)


def _read(names: Sequence[str], convention: Sequence[str], places: dict[str, int]) -> list[int] | None:
    """Places of names read by one convention; ``None`` where one of them fits no joint or two fit one."""
    kinds = dict(zip(convention, JOINTS_PER_LEG, strict=True))
    found = []
    for name in names:
        words = re.split(r"[^a-z0-9]+", name.lower().rpartition("/")[2].removesuffix("joint").rstrip("_-. "))
        if len(words) != 2 or words[1] not in kinds:
            return None
        joint = f"{_LEGS.get(words[0], words[0].upper())}_{kinds[words[1]]}"
        if joint not in places:
            return None
        found.append(places[joint])
    return found if len(set(found)) == len(found) else None


def _chosen(parts: Any, chosen: Sequence[int]) -> Any:
    """Some of several motors or gears side by side, in an order; a single number stays one."""
    columns = {item.name: np.asarray(getattr(parts, item.name)) for item in fields(parts)}
    return type(parts)(
        **{name: column[chosen] if column.ndim else column for name, column in columns.items()}
    )
