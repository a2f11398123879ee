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
    motors = {joint: find_motor(choices.joints[joint].motor) for joint in JOINTS_PER_LEG}
    return {
        **_body_sections(fitted, choices, source_name),
        "soft_stop": _soft_stop(choices, motors),
        **{
            f"joint.{joint}": _joint_section(fitted, choices, joint, motors[joint], source_name)
            for joint in JOINTS_PER_LEG
        },
        **{
            f"motor.{joint}": _motor_section(choices.joints[joint], motors[joint]) for joint in JOINTS_PER_LEG
        },
    }


def _body_sections(fitted: FittedRobot, choices: RobotChoices, source_name: str) -> Table:
    def given(value: Any, unit: str) -> Entry:
        return Entry(_rounded(value), unit, "as published", source_name)

    def chosen(value: Any, unit: str, basis: str) -> Entry:
        return Entry(_rounded(value), unit, "chosen", basis)

    legs = (fitted.abad.mass + fitted.thigh.mass + fitted.shank.mass + fitted.foot_mass) * 4
    standing = _standing_height(fitted, choices)
    height = choices.base_height_target or _HEIGHT_SHARE * standing
    return {
        "body": {
            "total_mass": given(fitted.trunk.mass + legs, "kg"),
            "base_height_target": chosen(height, "m", f"standing height {standing:.3f} m"),
            "bus_voltage": chosen(choices.bus_voltage, "V", "given at the import"),
        },
        "trunk": {
            **_link_entries(fitted.trunk, source_name, with_mass=False),
            "half_size": given(fitted.trunk_half_size, "m"),
            "hip_x": given(fitted.hip_x, "m"),
            "hip_y": given(fitted.hip_y, "m"),
        },
        "abad_link": {**_link_entries(fitted.abad, source_name), "offset_y": given(fitted.abad_offset, "m")},
        "thigh": {
            "length": given(fitted.thigh_length, "m"),
            **_link_entries(fitted.thigh, source_name),
            "collision_radius": given(fitted.radii[0], "m"),
        },
        "shank": {
            "length": given(fitted.shank_length, "m"),
            **_link_entries(fitted.shank, source_name),
            "collision_radius": given(fitted.radii[1], "m"),
        },
        "foot": {
            "mass": given(fitted.foot_mass, "kg"),
            "radius": given(fitted.foot_radius, "m"),
            "friction": chosen(choices.foot_friction, "1", "rubber on a dry floor; assumed"),
        },
    }


def _link_entries(link: FittedLink, source_name: str, with_mass: bool = True) -> dict[str, Entry]:
    inertia = link.inertia
    products = (inertia[0, 1], inertia[0, 2], inertia[1, 2])
    values: dict[str, tuple[Any, str]] = {"mass": (link.mass, "kg")} if with_mass else {}
    values["center_of_mass"] = (link.center, "m")
    values["inertia"] = (np.diag(inertia), "kg m^2")
    values["products_of_inertia"] = (products, "kg m^2")
    return {
        name: Entry(_rounded(value), unit, "as published", source_name)
        for name, (value, unit) in values.items()
    }


def default_pose(fitted: FittedRobot, choices: RobotChoices) -> dict[str, float]:
    """Joint angles of a zero action [rad]: as chosen, else a bent knee with the foot under the hip."""
    given = {joint: choices.joints[joint].default_angle for joint in JOINTS_PER_LEG}
    low, high = fitted.ranges["knee"]
    room = 0.1 * (high - low) + _SOFT_ZONE
    knee = (
        given["knee"] if given["knee"] is not None else min(max(-_DEFAULT_KNEE_BEND, low + room), high - room)
    )
    shank, thigh = fitted.shank_length, fitted.thigh_length
    under = math.atan2(-shank * math.sin(knee), thigh + shank * math.cos(knee))
    hip = given["hip"] if given["hip"] is not None else under
    return {"abad": given["abad"] or 0.0, "hip": hip, "knee": knee}


def _standing_height(fitted: FittedRobot, choices: RobotChoices) -> float:
    pose = default_pose(fitted, choices)
    leg = fitted.thigh_length * math.cos(pose["hip"])
    leg += fitted.shank_length * math.cos(pose["hip"] + pose["knee"])
    return leg + fitted.foot_radius


def peak_joint_torque(choice: JointChoice, motor: PmsmParameters) -> float:
    """Torque on the joint at standstill [N m]."""
    gear = Gear(ratio=choice.gear_ratio, efficiency=choice.gear_efficiency)
    return float(joint_torque(gear, saturate(motor, float(motor.peak_torque))))


def _soft_stop(choices: RobotChoices, motors: dict[str, PmsmParameters]) -> dict[str, Entry]:
    """A stop that takes the strongest joint's peak torque at twice the zone."""
    torque = max(peak_joint_torque(choices.joints[joint], motors[joint]) for joint in JOINTS_PER_LEG)
    stiffness = torque / (2.0 * _SOFT_ZONE)
    basis = "assumed: peak torque at twice the zone"
    return {
        "zone": Entry(_SOFT_ZONE, "rad", "x or / 3", "assumed"),
        "stiffness": Entry(_rounded(stiffness), "N m/rad", "x or / 3", basis),
        "damping": Entry(
            _rounded(0.01 * stiffness), "N m s/rad", "x or / 3", "assumed: 0.01 s of the stiffness"
        ),
    }


def _joint_section(
    fitted: FittedRobot, choices: RobotChoices, joint: str, motor: PmsmParameters, source_name: str
) -> dict[str, Entry]:
    choice, pose = choices.joints[joint], default_pose(fitted, choices)

    def pick(given: float | None, derived: float, unit: str, basis: str) -> Entry:
        if given is not None:
            return Entry(_rounded(given), unit, "chosen", "given at the import")
        return Entry(_rounded(derived), unit, "chosen", basis)

    stiffness = choice.stiffness or peak_joint_torque(choice, motor) / _STIFFNESS_ERROR
    return {
        "default_angle": pick(choice.default_angle, pose[joint], "rad", "bent leg, foot under the hip"),
        "range": Entry(_rounded(fitted.ranges[joint]), "rad", "as published", source_name),
        "stiffness": pick(choice.stiffness, stiffness, "N m/rad", "peak torque at 0.45 rad of error"),
        "damping": pick(choice.damping, _DAMPING_TIME * stiffness, "N m s/rad", "0.03 s of the stiffness"),
        "action_scale": pick(choice.action_scale, _ACTION_SCALES[joint], "rad", "as for BP2"),
        "viscous_friction": pick(
            choice.viscous_friction, fitted.viscous_friction[joint], "N m s/rad", source_name
        ),
        "dry_friction": pick(choice.dry_friction, fitted.dry_friction[joint], "N m", source_name),
    }


def _motor_section(choice: JointChoice, motor: PmsmParameters) -> dict[str, Entry]:
    basis = f"motor {choice.motor}"
    entries = {
        name: Entry(_exact(float(getattr(motor, name))), unit or "1", "as in its source", basis)
        for name, unit in MOTOR_UNITS.items()
    }
    entries["pole_pairs"] = Entry(int(motor.pole_pairs), "1", "exact", basis)
    entries["gear_ratio"] = Entry(choice.gear_ratio, "1", "chosen", "given at the import")
    entries["gear_efficiency"] = Entry(choice.gear_efficiency, "1", "±0.03", "given at the import")
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
