"""The parameter table of an imported robot, as text: every number with unit, uncertainty and basis."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from sprintlab.core.constants import GRAVITY
from sprintlab.core.errors import printable
from sprintlab.motors import Gear, PmsmParameters, joint_torque, saturate
from sprintlab.motors.parameters import MOTOR_UNITS
from sprintlab.robots.description import JOINTS_PER_LEG
from sprintlab.robots.importing.choices import JointChoice, RobotChoices, find_motor
from sprintlab.robots.importing.fit import FittedLink, FittedRobot
from sprintlab.robots.table import KINDS, ParameterRow

_STIFFNESS_ERROR = 0.45  # rad of error at which the controller asks for the peak torque
_DAMPING_TIME = 0.03  # s: derivative over proportional gain
_SOFT_ZONE = 0.08  # rad
_DEFAULT_KNEE_BEND = 1.2  # rad
_HEIGHT_SHARE = 0.92  # share of the standing height, to run at
_GIVEN = "given at the import"
_ACTION_TORQUES = {"abad": 0.0665, "hip": 0.355, "knee": 0.355}
"""What an action of one asks of a joint at rest, over weight times length of the leg [-], as on BP2. Training
begins with noise on the action: where that asks for more, it throws robots over and saturates motors."""

Rows = dict[str, ParameterRow]
"""Rows of a table by quantity."""


def robot_table(fitted: FittedRobot, choices: RobotChoices, source_name: str) -> Rows:
    """The parameter table: what the model file says, and what it does not say."""
    rows, given = Rows(), ("as published", source_name)

    def add(section: str, uncertainty: str, basis: str, **values: Any) -> None:
        for field, value in values.items():
            quantity, unit = f"{section}.{field}", KINDS[field].unit
            rows[quantity] = ParameterRow(
                quantity=quantity, value=value, unit=unit, uncertainty=uncertainty, basis=basis
            )

    pose, motors = default_pose(fitted, choices), dict[str, PmsmParameters]()
    standing = fitted.thigh_length * math.cos(pose["hip"]) + fitted.foot_radius
    standing += fitted.shank_length * math.cos(pose["hip"] + pose["knee"])
    height = choices.base_height_target or _HEIGHT_SHARE * standing
    trunk = _link(fitted.trunk)
    del trunk["mass"]  # what the legs leave of the total
    add("body", *given, total_mass=_rounded(fitted.mass))
    add("body", "chosen", f"standing height {standing:.3f} m", base_height_target=_rounded(height))
    add("body", "chosen", _GIVEN, bus_voltage=_rounded(choices.bus_voltage))
    sizes = {name: _rounded(getattr(fitted, name)) for name in ("hip_x", "hip_y")}
    add("trunk", *given, **trunk, half_size=_rounded(fitted.trunk_half_size), **sizes)
    add("abad_link", *given, **_link(fitted.abad), offset_y=_rounded(fitted.abad_offset))
    for name, part, radius in (("thigh", fitted.thigh, 0), ("shank", fitted.shank, 1)):
        length, around = _rounded(getattr(fitted, f"{name}_length")), _rounded(fitted.radii[radius])
        add(name, *given, length=length, **_link(part), collision_radius=around)
    add("foot", *given, mass=_rounded(fitted.foot_mass), radius=_rounded(fitted.foot_radius))
    friction = _rounded(choices.foot_friction)
    add("foot", "chosen", "rubber on a dry floor; assumed", friction=friction)
    for joint in JOINTS_PER_LEG:
        motors[joint] = find_motor(choices.joints[joint].motor)
    torque = max(peak_joint_torque(choices.joints[joint], motors[joint]) for joint in JOINTS_PER_LEG)
    stiffness, unsure = torque / (2.0 * _SOFT_ZONE), "x or / 3"
    add("soft_stop", unsure, "assumed", zone=_SOFT_ZONE)
    add("soft_stop", unsure, "assumed: peak torque at twice the zone", stiffness=_rounded(stiffness))
    add("soft_stop", unsure, "assumed: 0.01 s of the stiffness", damping=_rounded(0.01 * stiffness))
    for joint in JOINTS_PER_LEG:
        for name, value, basis in _joint(fitted, choices.joints[joint], joint, pose, motors, source_name):
            add(f"joint.{joint}", "chosen", basis, **{name: _rounded(value)})
            if name == "default_angle":
                add(f"joint.{joint}", *given, range=_rounded(fitted.ranges[joint]))
    for joint, motor in motors.items():
        choice, section = choices.joints[joint], f"motor.{joint}"
        numbers = {name: _exact(float(getattr(motor, name))) for name in MOTOR_UNITS}
        add(section, "as in its source", f"motor {choice.motor}", **numbers)
        add(section, "exact", f"motor {choice.motor}", pole_pairs=int(motor.pole_pairs))
        add(section, "chosen", _GIVEN, gear_ratio=choice.gear_ratio)
        add(section, "±0.03", _GIVEN, gear_efficiency=choice.gear_efficiency)
    return rows


def _link(part: FittedLink) -> dict[str, Any]:
    products = (part.inertia[0, 1], part.inertia[0, 2], part.inertia[1, 2])
    return {
        "mass": _rounded(part.mass),
        "center_of_mass": _rounded(part.center),
        "inertia": _rounded(np.diag(part.inertia)),
        "products_of_inertia": _rounded(products),
    }


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


def _joint(
    fitted: FittedRobot,
    choice: JointChoice,
    joint: str,
    pose: Mapping[str, float],
    motors: Mapping[str, PmsmParameters],
    source_name: str,
) -> Iterator[tuple[str, float, str]]:
    """Name, value and basis of what may be chosen for a joint."""
    stiffness = choice.stiffness or peak_joint_torque(choice, motors[joint]) / _STIFFNESS_ERROR
    share = _ACTION_TORQUES[joint]
    scale = share * fitted.mass * GRAVITY * fitted.leg_length / stiffness
    for name, value, basis in (
        ("default_angle", pose[joint], "bent leg, foot under the hip"),
        ("stiffness", stiffness, "peak torque at 0.45 rad of error"),
        ("damping", _DAMPING_TIME * stiffness, "0.03 s of the stiffness"),
        (
            "action_scale",
            float(f"{scale:.3g}"),
            f"an action of one asks for {share:g} of weight times leg, as on BP2",
        ),
        ("viscous_friction", fitted.viscous_friction[joint], source_name),
        ("dry_friction", fitted.dry_friction[joint], source_name),
    ):
        given = getattr(choice, name)
        yield (name, value, basis) if given is None else (name, given, _GIVEN)


def _rounded(value: Any) -> float | tuple[float, ...]:
    """Seven digits: more than any model file means."""
    if np.ndim(value):
        return tuple(_exact(float(f"{item:.7g}")) for item in np.asarray(value, dtype=float))
    return _exact(float(f"{value:.7g}"))


def _exact(value: float) -> float:
    return value if abs(value) > 1e-14 else 0.0  # what is left of a cancellation, and -0.0


def table_text(name: str, rows: Mapping[str, ParameterRow], source_name: str) -> str:
    """The table as TOML."""
    lines = [
        f"# {name}, read from {printable(source_name)}. Every number the robot is built from is here, once.",
        "#",
        "# Each entry: value, SI unit, uncertainty, basis. Frames: x forward, y left, z up; links are given",
        "# for a left leg, the right one mirrors y. Motor quantities are on the motor's side of the gear.",
        "",
        f'name = "{name}"',
    ]
    sections: dict[str, list[str]] = {}
    for quantity, row in rows.items():
        section, _, field = quantity.rpartition(".")
        value = f"[{', '.join(map(repr, row.value))}]" if isinstance(row.value, tuple) else repr(row.value)
        words = {"unit": row.unit, "uncertainty": row.uncertainty, "basis": row.basis}
        rest = ", ".join(f'{key} = "{_escaped(text)}"' for key, text in words.items())
        sections.setdefault(section, []).append(f"{field} = {{ value = {value}, {rest} }}")
    for section, entries in sections.items():
        lines += ["", f"[{section}]", *entries]
    return "\n".join(lines) + "\n"


def _escaped(text: str) -> str:
    return printable(text).replace("\\", "\\\\").replace('"', '\\"')
