"""The parameter table of an imported robot, as text: every number with unit, uncertainty and basis."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from sprintlab.core.errors import printable
from sprintlab.motors import Gear, PmsmParameters, joint_torque, saturate
from sprintlab.motors.parameters import MOTOR_UNITS
from sprintlab.robots.description import JOINTS_PER_LEG
from sprintlab.robots.importing.choices import JointChoice, RobotChoices, find_motor
from sprintlab.robots.importing.fit import FittedLink, FittedRobot

_STIFFNESS_ERROR = 0.45  # rad of error at which the controller asks for the peak torque
_DAMPING_TIME = 0.03  # s: derivative over proportional gain
_SOFT_ZONE = 0.08  # rad
_DEFAULT_KNEE_BEND = 1.2  # rad
_HEIGHT_SHARE = 0.92  # of the standing height, to run at
_GIVEN = "given at the import"
_ACTION_SCALES = {"abad": 0.25, "hip": 0.5, "knee": 0.5}


@dataclass(frozen=True)
class Entry:
    """One number of the table: value, unit, uncertainty, basis."""

    value: float | tuple[float, ...]
    unit: str
    uncertainty: str
    basis: str


Table = dict[str, dict[str, Entry]]


def robot_table(fitted: FittedRobot, choices: RobotChoices, source_name: str) -> Table:
    """All sections of the parameter table.

    Args:
        fitted: what the model file says.
        choices: what it does not say.
        source_name: name of the model file, for the column of sources.

    Raises:
        SprintlabError: a motor cannot be found.
    """

    def given(value: Any, unit: str) -> Entry:
        return Entry(_rounded(value), unit, "as published", source_name)

    def link(part: FittedLink) -> dict[str, Entry]:
        products = (part.inertia[0, 1], part.inertia[0, 2], part.inertia[1, 2])
        return {
            "mass": given(part.mass, "kg"),
            "center_of_mass": given(part.center, "m"),
            "inertia": given(np.diag(part.inertia), "kg m^2"),
            "products_of_inertia": given(products, "kg m^2"),
        }

    motors = {joint: find_motor(choices.joints[joint].motor) for joint in JOINTS_PER_LEG}
    pose = default_pose(fitted, choices)
    leg_mass = fitted.abad.mass + fitted.thigh.mass + fitted.shank.mass + fitted.foot_mass
    standing = fitted.thigh_length * math.cos(pose["hip"]) + fitted.foot_radius
    standing += fitted.shank_length * math.cos(pose["hip"] + pose["knee"])
    height = choices.base_height_target or _HEIGHT_SHARE * standing
    trunk = link(fitted.trunk)
    del trunk["mass"]  # what the legs leave of the total
    return {
        "body": {
            "total_mass": given(fitted.trunk.mass + 4 * leg_mass, "kg"),
            "base_height_target": _chosen(height, "m", f"standing height {standing:.3f} m"),
            "bus_voltage": _chosen(choices.bus_voltage, "V", _GIVEN),
        },
        "trunk": {
            **trunk,
            "half_size": given(fitted.trunk_half_size, "m"),
            "hip_x": given(fitted.hip_x, "m"),
            "hip_y": given(fitted.hip_y, "m"),
        },
        "abad_link": {**link(fitted.abad), "offset_y": given(fitted.abad_offset, "m")},
        "thigh": {
            "length": given(fitted.thigh_length, "m"),
            **link(fitted.thigh),
            "collision_radius": given(fitted.radii[0], "m"),
        },
        "shank": {
            "length": given(fitted.shank_length, "m"),
            **link(fitted.shank),
            "collision_radius": given(fitted.radii[1], "m"),
        },
        "foot": {
            "mass": given(fitted.foot_mass, "kg"),
            "radius": given(fitted.foot_radius, "m"),
            "friction": _chosen(choices.foot_friction, "1", "rubber on a dry floor; assumed"),
        },
        "soft_stop": _soft_stop(choices, motors),
        **{
            f"joint.{joint}": _joint_section(
                fitted, choices.joints[joint], joint, pose[joint], motors[joint], source_name
            )
            for joint in JOINTS_PER_LEG
        },
        **{
            f"motor.{joint}": _motor_section(choices.joints[joint], motors[joint]) for joint in JOINTS_PER_LEG
        },
    }


def _chosen(value: Any, unit: str, basis: str) -> Entry:
    return Entry(_rounded(value), unit, "chosen", basis)


def default_pose(fitted: FittedRobot, choices: RobotChoices) -> dict[str, float]:
    """Joint angles of a zero action [rad]: as chosen, else a bent knee with the foot under the hip."""
    given = {joint: choices.joints[joint].default_angle for joint in JOINTS_PER_LEG}
    low, high = fitted.ranges["knee"]
    room = 0.1 * (high - low) + _SOFT_ZONE
    knee = given["knee"]
    if knee is None:
        knee = min(max(-_DEFAULT_KNEE_BEND, low + room), high - room)
    shank, thigh = fitted.shank_length, fitted.thigh_length
    under = math.atan2(-shank * math.sin(knee), thigh + shank * math.cos(knee))
    return {
        "abad": given["abad"] or 0.0,
        "hip": under if given["hip"] is None else given["hip"],
        "knee": knee,
    }


def peak_joint_torque(choice: JointChoice, motor: PmsmParameters) -> float:
    """Torque on the joint at standstill [N m]."""
    gear = Gear(ratio=choice.gear_ratio, efficiency=choice.gear_efficiency)
    return float(joint_torque(gear, saturate(motor, float(motor.peak_torque))))


def _soft_stop(choices: RobotChoices, motors: dict[str, PmsmParameters]) -> dict[str, Entry]:
    """A stop that takes the strongest joint's peak torque at twice the zone."""
    torque = max(peak_joint_torque(choices.joints[joint], motors[joint]) for joint in JOINTS_PER_LEG)
    stiffness, unsure = torque / (2.0 * _SOFT_ZONE), "x or / 3"
    basis, damped = "assumed: peak torque at twice the zone", "assumed: 0.01 s of the stiffness"
    return {
        "zone": Entry(_SOFT_ZONE, "rad", unsure, "assumed"),
        "stiffness": Entry(_rounded(stiffness), "N m/rad", unsure, basis),
        "damping": Entry(_rounded(0.01 * stiffness), "N m s/rad", unsure, damped),
    }


def _joint_section(
    fitted: FittedRobot,
    choice: JointChoice,
    joint: str,
    angle: float,
    motor: PmsmParameters,
    source_name: str,
) -> dict[str, Entry]:
    stiffness = choice.stiffness or peak_joint_torque(choice, motor) / _STIFFNESS_ERROR
    derived = {
        "default_angle": (angle, "rad", "bent leg, foot under the hip"),
        "stiffness": (stiffness, "N m/rad", "peak torque at 0.45 rad of error"),
        "damping": (_DAMPING_TIME * stiffness, "N m s/rad", "0.03 s of the stiffness"),
        "action_scale": (_ACTION_SCALES[joint], "rad", "as for BP2"),
        "viscous_friction": (fitted.viscous_friction[joint], "N m s/rad", source_name),
        "dry_friction": (fitted.dry_friction[joint], "N m", source_name),
    }
    entries: dict[str, Entry] = {}
    for name, (value, unit, basis) in derived.items():
        given = getattr(choice, name)
        entries[name] = _chosen(value, unit, basis) if given is None else _chosen(given, unit, _GIVEN)
        if name == "default_angle":
            limits = _rounded(fitted.ranges[joint])
            entries["range"] = Entry(limits, "rad", "as published", source_name)
    return entries


def _motor_section(choice: JointChoice, motor: PmsmParameters) -> dict[str, Entry]:
    basis = f"motor {choice.motor}"
    entries = {
        name: Entry(_exact(float(getattr(motor, name))), unit or "1", "as in its source", basis)
        for name, unit in MOTOR_UNITS.items()
    }
    entries["pole_pairs"] = Entry(int(motor.pole_pairs), "1", "exact", basis)
    entries["gear_ratio"] = Entry(choice.gear_ratio, "1", "chosen", _GIVEN)
    entries["gear_efficiency"] = Entry(choice.gear_efficiency, "1", "±0.03", _GIVEN)
    return entries


def _rounded(value: Any) -> float | tuple[float, ...]:
    """Seven digits: more than any model file means."""
    if np.ndim(value):
        return tuple(_exact(float(f"{item:.7g}")) for item in np.asarray(value, dtype=float))
    return _exact(float(f"{value:.7g}"))


def _exact(value: float) -> float:
    return value if abs(value) > 1e-14 else 0.0  # what is left of a cancellation, and -0.0


def table_text(name: str, table: Table, source_name: str) -> str:
    """The table as TOML."""
    lines = [
        f"# {name}, read from {printable(source_name)}. Every number the robot is built from is here, once.",
        "#",
        "# Each entry: value, SI unit, uncertainty, basis. Frames: x forward, y left, z up; links are given",
        "# for a left leg, the right one mirrors y. Motor quantities are on the motor's side of the gear.",
        "",
        f'name = "{name}"',
    ]
    for section, entries in table.items():
        lines += ["", f"[{section}]"]
        lines += [f"{field} = {_entry_text(entry)}" for field, entry in entries.items()]
    return "\n".join(lines) + "\n"


def _entry_text(entry: Entry) -> str:
    value = f"[{', '.join(map(repr, entry.value))}]" if isinstance(entry.value, tuple) else repr(entry.value)
    words = {"unit": entry.unit, "uncertainty": entry.uncertainty, "basis": entry.basis}
    rest = ", ".join(f'{field} = "{_escaped(text)}"' for field, text in words.items())
    return f"{{ value = {value}, {rest} }}"


def _escaped(text: str) -> str:
    return printable(text).replace("\\", "\\\\").replace('"', '\\"')
