"""The BP2 surrogate as a family: from a choice of motor, gears, spring and legs to a robot's parameter table.

    python recipes/bp2_editions.py

writes the tables of the robots ``bp2``, ``bp2-weak`` and ``bp2-strong`` anew from ``EDITIONS``; the
calibration of the speed limit walks the same family. Rows that do not follow from a choice (geometry, stops,
gains, friction) are bp2's own: edit them there, then run this.

Motors are a T-motor U12 with another stack length ``s``, rewound for the same flux: ``R (0.4 + 0.6 s) / s^2``
(0.4 of the winding are its end turns), ``L / s``, ``tau s``, ``J s``, mass ``m (0.3 + 0.7 s)``. The hip's
motor sits in the abduction link, the knee's in the thigh on the hip axis; the trunk takes the mass that the
legs leave of the total.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from sprintlab import robots
from sprintlab.core.checks import check_positive, check_range
from sprintlab.core.files import atomic_write_text
from sprintlab.robots.description import FloatArray, RobotDescription
from sprintlab.robots.loader import describe_table, robot_table_path
from sprintlab.robots.table import ParameterRow, ParameterTable, read_table

TEMPLATE = "bp2"
_ENDS = {"bp2": "nominal", "bp2-weak": "weak end of the uncertainties", "bp2-strong": "strong end"}
HEADING = """# BP2 surrogate, {end}.
# Nothing of BP2's geometry, springs or motors is public: this is a set of stated assumptions. Motor and gears
# were chosen by the speed limits that follow from them, before any training (docs/speed-limit.md); the rest
# is derived from published machines. Written by recipes/bp2_editions.py.
#
# Each entry: value, SI unit, uncertainty, basis. Frames: x forward, y left, z up; links are given for a left
# leg, the right one mirrors y. Motor quantities are on the motor's side of the gear."""


U12_RESISTANCE, U12_INDUCTANCE, U12_FLUX = 0.158, 84.0e-6, 0.00608
U12_PEAK_TORQUE, U12_ROTOR_INERTIA = 12.0, 5.548e-4
U12_MASS, HOUSING_SHARE = 0.78, 0.3
_MOTOR_RADIUS, _MOTOR_WIDTH = 0.05, 0.04
_END_TURNS = 0.4

# Links with a motor of stack 1.25 in each, which is taken out again.
_LINKS_STACK = 1.25
_ABAD_MASS, _ABAD_INERTIA = 1.45, (0.0017, 0.0022, 0.0017)
_THIGH_MASS, _THIGH_CENTER, _THIGH_INERTIA = 2.05, (0.0, -0.02, -0.062), (0.0190, 0.0187, 0.0030)
_THIGH_LENGTH = 0.31
_SHANK_LENGTH, _SHANK_MASS, _SHANK_CENTER = 0.32, 0.25, -0.168
_SHANK_INERTIA, _FOOT_MASS = (0.0024, 0.0024, 0.0001), 0.06
_TRUNK_BOX = (0.62, 0.22, 0.16)
_CARRIER_MASS = 0.05

Value = float | tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class Surrogate:
    """One member of the family.

    Attributes:
        stack: stack length of the hip and knee motors, U12 = 1.
        hip_gear: gear ratio of the hip.
        knee_gear: gear ratio of the knee.
        spring: stiffness of the knee springs [N m/rad].
        leg: factor on the leg's lengths; 1 is 0.63 m.
        total_mass: [kg].
        resistance: factor on the stator resistance.
        inductance: factor on the q-axis inductance.
        flux: factor on the flux linkage.
        peak_torque: factor on the motors' peak torque.
        rotor_inertia: factor on the rotor inertia.
        saturation: torque lost at peak torque, as a share.
        gear_efficiency: of all gears.
        leg_inertia: factor on mass and inertia of the leg's links, motors left out.

    Raises:
        InvalidValueError: a field is not positive, or a share out of range.
    """

    stack: float
    hip_gear: float
    knee_gear: float
    spring: float = 800.0
    leg: float = 1.0
    total_mass: float = 36.5
    resistance: float = 1.0
    inductance: float = 1.0
    flux: float = 1.0
    peak_torque: float = 1.0
    rotor_inertia: float = 1.0
    saturation: float = 0.15
    gear_efficiency: float = 0.95
    leg_inertia: float = 1.0

    def __post_init__(self) -> None:
        for field in fields(self):
            check_positive(field.name, getattr(self, field.name))
        check_range("saturation", self.saturation, 0.0, 0.49)
        check_range("gear_efficiency", self.gear_efficiency, 0.5, 1.0)


_NOMINAL = Surrogate(stack=1.25, hip_gear=8.25, knee_gear=7.75)

EDITIONS: dict[str, Surrogate] = {
    TEMPLATE: _NOMINAL,
    "bp2-weak": replace(
        _NOMINAL,
        hip_gear=8.5,
        knee_gear=7.98,
        spring=1000.0,
        total_mass=38.0,
        resistance=1.10,
        inductance=1.15,
        flux=1.04,
        peak_torque=0.92,
        rotor_inertia=1.2,
        saturation=0.20,
        gear_efficiency=0.935,
        leg_inertia=1.2,
    ),
    "bp2-strong": replace(
        _NOMINAL,
        hip_gear=8.0,
        knee_gear=7.52,
        spring=640.0,
        resistance=0.90,
        inductance=0.85,
        flux=0.96,
        peak_torque=1.08,
        rotor_inertia=0.8,
        saturation=0.10,
        gear_efficiency=0.965,
        leg_inertia=0.8,
    ),
}
"""The choice, from results/speed_limit/bp2.json by the rules of docs/speed-limit.md, and the two ends.

An end takes every uncertain number to the middle between its nominal value and the end of its stated
uncertainty, all to the same side at once: about 1.4 times what independent errors of that size add up to.
"""


def surrogate_robot(choice: Surrogate, name: str = TEMPLATE) -> RobotDescription:
    """The robot of a choice; ``name`` is the name it carries."""
    return describe_table(surrogate_table(choice, name))


def surrogate_table(choice: Surrogate, name: str = TEMPLATE) -> ParameterTable:
    """Its parameter table: the template's rows with the numbers that follow from the choice."""
    rows = dict(read_table(robot_table_path(TEMPLATE)).rows)
    nominal = surrogate_values(EDITIONS[TEMPLATE])
    for quantity, value in surrogate_values(choice).items():
        basis = re.sub(r"stack x [\d.]+", f"stack x {choice.stack:g}", rows[quantity].basis)
        if name in EDITIONS and _rounded(value) != _rounded(nominal[quantity]):
            basis += f"; here the {name.rpartition('-')[2]} end"
        rows[quantity] = replace(rows[quantity], value=_rounded(value), basis=basis)
    return ParameterTable(name=name, rows=rows)


def motor_mass(stack: float) -> float:
    """Mass of a motor by its stack length [kg]: the housing stays, iron, copper and magnets grow."""
    return U12_MASS * (HOUSING_SHARE + (1.0 - HOUSING_SHARE) * stack)


def surrogate_values(choice: Surrogate) -> dict[str, Value]:
    """What follows from a choice, by the names of the parameter table."""
    values: dict[str, Value] = {
        "body.total_mass": choice.total_mass,
        "knee_spring.stiffness": choice.spring,
        "motor.flux_linkage": U12_FLUX * choice.flux,
        "motor.saturation": choice.saturation,
        "motor.gear_efficiency": choice.gear_efficiency,
        "motor.hip.gear_ratio": choice.hip_gear,
        "motor.knee.gear_ratio": choice.knee_gear,
        **_motor_values("motor.abad", choice, 1.0),
        **_motor_values("motor.hip_knee", choice, choice.stack),
        **_link_values(choice),
    }
    legs = 4.0 * sum(_number(values[f"{link}.mass"]) for link in ("abad_link", "thigh", "shank", "foot"))
    trunk = choice.total_mass - legs - 4.0 * _CARRIER_MASS
    x, y, z = _TRUNK_BOX
    inertia = trunk / 12.0 * np.array((y * y + z * z, x * x + z * z, x * x + y * y))
    return {**values, "trunk.inertia": tuple(inertia)}


def _number(value: Value) -> float:
    assert not isinstance(value, tuple)
    return value


def _motor_values(section: str, choice: Surrogate, stack: float) -> dict[str, Value]:
    winding = (_END_TURNS + (1.0 - _END_TURNS) * stack) / stack**2
    return {
        f"{section}.stator_resistance": U12_RESISTANCE * winding * choice.resistance,
        f"{section}.q_axis_inductance": U12_INDUCTANCE / stack * choice.inductance,
        f"{section}.peak_torque": U12_PEAK_TORQUE * stack * choice.peak_torque,
        f"{section}.rotor_inertia": U12_ROTOR_INERTIA * stack * choice.rotor_inertia,
    }


def _link_values(choice: Surrogate) -> dict[str, Value]:
    heavier, longer, motor = choice.leg_inertia, choice.leg, motor_mass(choice.stack)
    first = motor_mass(_LINKS_STACK)
    abad = _ABAD_MASS - first
    thigh, center, inertia = _thigh(choice)
    inside = np.array(_ABAD_INERTIA) - _motor_inertia(first)
    return {
        "abad_link.mass": abad * heavier + motor,
        "abad_link.inertia": tuple(inside * heavier + _motor_inertia(motor)),
        "thigh.length": _THIGH_LENGTH * longer,
        "thigh.mass": thigh,
        "thigh.center_of_mass": (0.0, _THIGH_CENTER[1], center),
        "thigh.inertia": tuple(inertia),
        "shank.length": _SHANK_LENGTH * longer,
        "shank.mass": _SHANK_MASS * heavier,
        "shank.center_of_mass": (0.0, 0.0, _SHANK_CENTER * longer),
        "shank.inertia": tuple(np.array(_SHANK_INERTIA) * heavier * np.array((longer**2, longer**2, 1.0))),
        "foot.mass": _FOOT_MASS * heavier,
    }


def _thigh(choice: Surrogate) -> tuple[float, float, FloatArray]:
    """Mass, height of the centre of mass and inertia of the thigh: link plus knee motor on the hip axis."""
    first, motor = motor_mass(_LINKS_STACK), motor_mass(choice.stack)
    bare = _THIGH_MASS - first
    bare_center = _THIGH_CENTER[2] * _THIGH_MASS / bare
    apart = first * _THIGH_CENTER[2] ** 2 + bare * (bare_center - _THIGH_CENTER[2]) ** 2
    bare_inertia = np.array(_THIGH_INERTIA) - _motor_inertia(first) - np.array((apart, apart, 0.0))
    stretch = np.array((choice.leg**2, choice.leg**2, 1.0))
    bare, bare_center = bare * choice.leg_inertia, bare_center * choice.leg
    bare_inertia = bare_inertia * choice.leg_inertia * stretch
    mass = bare + motor
    center = bare * bare_center / mass
    apart = motor * center**2 + bare * (bare_center - center) ** 2
    return mass, center, bare_inertia + _motor_inertia(motor) + np.array((apart, apart, 0.0))


def _motor_inertia(mass: float) -> FloatArray:
    """Moments of a motor as a full cylinder with its axis along y ``(3,)`` [kg m^2]."""
    across = mass * (3.0 * _MOTOR_RADIUS**2 + _MOTOR_WIDTH**2) / 12.0
    return np.array((across, 0.5 * mass * _MOTOR_RADIUS**2, across))


def _rounded(value: Value) -> Value:
    """Four significant digits: no more is known."""
    if isinstance(value, tuple):
        return tuple(float(f"{number:.4g}") for number in value)
    return float(f"{value:.4g}")


def table_text(table: ParameterTable, heading: str) -> str:
    """A parameter table as TOML, one line a quantity, sections in the table's order."""
    lines, section = [heading, "", f'name = "{table.name}"'], ""
    for quantity, row in table.rows.items():
        place, _, key = quantity.rpartition(".")
        if place != section:
            section = place
            lines += ["", f"[{section}]"]
        lines.append(f"{key} = {{ {_entry(row)} }}")
    return "\n".join(lines) + "\n"


def _entry(row: ParameterRow) -> str:
    words: Mapping[str, Any] = {"unit": row.unit, "uncertainty": row.uncertainty, "basis": row.basis}
    number = list(row.value) if isinstance(row.value, tuple) else row.value
    return ", ".join((f"value = {number}", *(f'{field} = "{text}"' for field, text in words.items())))


def text_of(name: str) -> str:
    """The table of an edition as it stands in the package."""
    return table_text(surrogate_table(EDITIONS[name], name), HEADING.format(end=_ENDS[name]))


def main() -> None:
    """Write the tables that differ."""
    for name in EDITIONS:
        path = Path(robots.__file__).parent / name / "parameters.toml"
        text = text_of(name)
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            path.parent.mkdir(exist_ok=True)
            atomic_write_text(path, text)
            print(f"wrote {path}")


if __name__ == "__main__":
    main()
