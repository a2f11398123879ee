"""Puts the C++ together: numbers of the backend, the robot's constants, generated and written code."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from importlib.resources import files

import mujoco
import numpy as np

from sprintlab.core.errors import RobotModelError
from sprintlab.engine.algebra import Algebra
from sprintlab.engine.dynamics import FOOT_VALUES, leg_source, trunk_source, waist_source
from sprintlab.engine.options import EngineOptions
from sprintlab.engine.tree import Tree, read_tree
from sprintlab.motors import (
    COPPER_COEFFICIENT,
    MOTOR_MODELS,
    TURNING_SPEED,
    Battery,
    i2t_decay,
    joint_torque,
    no_load_speed,
    phase_voltage_limit,
    saturate,
)
from sprintlab.robots import (
    AIR_DENSITY,
    ModelOptions,
    RobotDescription,
    build_model,
    effective_leg_mass,
    foot_masses,
)

BUS_STEPS = 12
"""Secants by which the voltage of a shared bus is found: they leave less than 0.1 mV."""
FRICTION_SPEED = 0.2
"""Joint speed over which dry friction reaches 76 % of its value [rad/s]: a smooth stand-in for sticking."""
PARAMETERS = (
    "pad_stiffness", "pad_damping", "friction", "voltage", "resistance_factor", "friction_factor",
    "drag_area", "trunk_mass", "trunk_center_x", "trunk_center_y", "trunk_center_z",
    "gravity_x", "gravity_y", "gravity_z", "weight", "timestep",
)  # fmt: skip
"""Columns of the parameters that differ from robot to robot."""
PAIRS = ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))
"""All pairs of legs, in the order of ``leg_distance``."""
JOINT_INPUTS = ("target", "previous_target", "stiffness", "damping", "strength")
STATE = (
    "qpos",
    "qvel",
    "bristle",
    "winding_temperature",
    "i2t_level",
    "state_of_charge",
    "bus_voltage",
    "recent_force",
    "loaded",
    "since_touchdown",
    "carried",
)
JOINT_OUTPUTS = ("torque", "limit_share", "stop_depth", "joint_speed", "gear_torque")
FOOT_OUTPUTS = ("foot_force", "pad_deflection", "stance", "touchdowns", "hasty_touchdowns", "short_stances")
PLACE_OUTPUTS = ("foot_position", "foot_velocity", "knee_position", "contact_force")
TEST_BUFFERS = ("given_torque", "qacc")
BUFFERS = (
    *JOINT_INPUTS, "parameters", "shortest", *STATE, *JOINT_OUTPUTS, *FOOT_OUTPUTS, *PLACE_OUTPUTS,
    "leg_distance", "power", *TEST_BUFFERS,
)  # fmt: skip
"""Names of the buffers of floats, in the order of the kernel's argument; ``delay``, of integers, follows."""


@dataclass(frozen=True, kw_only=True, eq=False)
class EngineModel:
    """What is known of a robot before its code is written."""

    robot: RobotDescription  # its description
    model: mujoco.MjModel  # the compiled MuJoCo model, feet on a floor
    tree: Tree  # that model as the generator sees it
    options: EngineOptions  # what was chosen
    leg_mass: float  # effective vertical mass of a leg, for the pad's damping [kg]
    # mass that a foot alone shows at once, along the normal and along the ground [kg]
    foot_mass: tuple[float, float]


def engine_model(robot: RobotDescription, options: EngineOptions) -> EngineModel:
    """Read a robot.

    Raises:
        RobotModelError: the engine cannot express it.
    """
    chosen = ModelOptions(dry_friction=False, joint_limits=False, knee_spring=options.knee_spring)
    model = build_model(robot, chosen)
    tree = read_tree(model)
    names = [[robot.joint_names[j] for j in legs] for legs in robot.leg_joints]
    read = [[link.joint for link in leg.links if link.joint in robot.joint_names] for leg in tree.legs]
    if names != read:
        raise RobotModelError(
            f"the engine cannot simulate this robot: its legs' joints are {read}, not {names}"
        )
    x, y, z = np.mean(foot_masses(model, np.arange(model.nv)), axis=0)
    return EngineModel(
        robot=robot,
        model=model,
        tree=tree,
        options=options,
        leg_mass=effective_leg_mass(model),
        foot_mass=(float(z), float(math.sqrt(x * y))),
    )


def source(engine: EngineModel, backend: str, given_torque: bool = False) -> str:
    """The whole translation unit; ``backend`` is ``cpu`` or ``cuda``."""
    algebra = Algebra(len(engine.tree.legs))
    legs = leg_source(engine.tree, algebra)
    drives = _drive_source(engine, algebra)
    parts = [
        _defines(engine, algebra, given_torque),
        _native(f"{backend}_numbers.h"),
        _tables(engine, algebra),
        _buffers(),
        _native("trunk.h"),
        legs,
        waist_source(engine.tree) if engine.tree.waist else "",
        trunk_source(),
        _native("motors.h"),
        drives,
        _native("battery.h") if engine.options.battery else "",
        _native("contact.h"),
        _native("monitors.h"),
        _native("step.h"),
        _native("cpu.cpp" if backend == "cpu" else "cuda.cu"),
    ]
    return "\n".join(parts)


def _native(name: str) -> str:
    return (files("sprintlab.engine") / "native" / name).read_text(encoding="utf-8")


def _defines(engine: EngineModel, algebra: Algebra, given_torque: bool) -> str:
    tree, options, robot = engine.tree, engine.options, engine.robot
    links = len(tree.legs[0].links)
    values: dict[str, float | int] = {
        "LEGS": len(tree.legs),
        "LINKS": links,
        "DRIVES": len(_driven_links(engine)),
        "JOINTS": len(robot.joint_names),
        "NQ": tree.nq,
        "NV": tree.nv,
        "FOOT_VALUES": FOOT_VALUES,
        "LEG_CONSTANTS": max(len(algebra.table), 1),
        "SUBSTEPS": options.substeps,
        "BIN": options.bin,
        "WINDOW": options.window,
        "DISTANCE_PERIOD": options.distance_period,
        "PAIRS": len(PAIRS),
        "PAIR_SLOTS": 2,
        "MOTOR_MODEL": MOTOR_MODELS.index(options.motor_model),
        "TURNING_SPEED": TURNING_SPEED,
        "FRICTION_SPEED": FRICTION_SPEED,
        "AIR_DENSITY": AIR_DENSITY,
        "FOOT_RADIUS": tree.legs[0].radius,
        "SHANK_RADIUS": robot.mechanics.shank_radius,
        "THIGH_RADIUS": robot.mechanics.thigh_radius,
        "SHANK_LENGTH": robot.mechanics.shank_length,
        "THIGH_LENGTH": robot.mechanics.thigh_length,
        "LEG_MASS": engine.leg_mass,
        "FOOT_MASS_NORMAL": engine.foot_mass[0],
        "FOOT_MASS_ALONG": engine.foot_mass[1],
        "PARAMETERS": len(PARAMETERS),
        **{name.upper(): index for index, name in enumerate(PARAMETERS)},
        **_heat(options),
        **_supply(engine),
        **_waist(engine),
    }
    if given_torque:
        values["GIVEN_TORQUE"] = 1
    return "\n".join(f"#define {name} {value!r}" for name, value in values.items())


def _heat(options: EngineOptions) -> dict[str, float | int]:
    heat = options.heat
    if heat is None:
        return {}
    resistance, capacity = float(heat.thermal_resistance), float(heat.heat_capacity)
    reference = float(heat.reference_temperature)
    return {
        "HEAT": 1,
        "COPPER_COEFFICIENT": COPPER_COEFFICIENT,
        "COPPER_AT_REFERENCE": 1.0 + COPPER_COEFFICIENT * (reference - 20.0),
        "REFERENCE": reference,
        "AMBIENT": float(heat.ambient_temperature),
        "MAGNET_SHARE": float(heat.magnet_share),
        "FLUX_COEFFICIENT": float(heat.flux_coefficient),
        "THERMAL_RESISTANCE": resistance,
        "THERMAL_DECAY": math.exp(-options.timestep / (resistance * capacity)),
    }


def _supply(engine: EngineModel) -> dict[str, float | int]:
    """Constants of battery and I2t."""
    options, values = engine.options, dict[str, float | int]()
    if options.i2t is not None:
        values["I2T"] = 1
    pack = options.battery
    if pack is None:
        return values
    return values | {
        "BATTERY": 1,
        "BUS_STEPS": BUS_STEPS,
        "PACK_RESISTANCE": pack.internal_resistance,
        "REGENERATION_LIMIT": pack.regeneration_limit,
        "CHARGE_PER_AMPERE": options.loop_period / (3600.0 * pack.capacity),
        "CELL_POINTS": len(pack.charge_table),
        "PHASE_SHARE": float(phase_voltage_limit(1.0)),
    }


def _waist(engine: EngineModel) -> dict[str, int]:
    waist, robot = engine.tree.waist, engine.robot
    if waist is None or robot.waist is None:
        return {}
    rear = [index for index, leg in enumerate(engine.tree.legs) if leg.rear]
    return {
        "WAIST": 1,
        "REAR_LEG": rear[0],
        "WAIST_QPOS": waist.qpos,
        "WAIST_QVEL": waist.qvel,
        "WAIST_JOINT": robot.waist,
    }


def _driven_links(engine: EngineModel) -> list[int]:
    """Which links of a leg a motor drives."""
    names = engine.robot.joint_names
    return [index for index, link in enumerate(engine.tree.legs[0].links) if link.joint in names]


def _array(kind: str, name: str, values: Iterable[float | int]) -> str:
    numbers = [repr(value) for value in values]
    return f"CONSTANT {kind} {name}[{len(numbers)}] = {{{', '.join(numbers)}}};"


def _tables(engine: EngineModel, algebra: Algebra) -> str:
    tree, names = engine.tree, engine.robot.joint_names
    rows = np.array(algebra.table).T if algebra.table else np.zeros((len(tree.legs), 1))
    driven = _driven_links(engine)
    joints = [names.index(leg.links[index].joint) for leg in tree.legs for index in driven]
    inertia = tree.trunk.inertia
    upper = [inertia[a, b] for a, b in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))]
    return "\n".join(
        (
            _array("scalar", "LEG_TABLE", (float(value) for value in rows.ravel())),
            _array("scalar", "TRUNK_INERTIA", map(float, upper)),
            _array("int", "QPOS", (link.qpos for leg in tree.legs for link in leg.links)),
            _array("int", "QVEL", (link.qvel for leg in tree.legs for link in leg.links)),
            _array("int", "DRIVE_LINK", driven),
            _array("int", "DRIVE_JOINT", joints),
            *_cells(engine.options.battery),
            _array("int", "PAIR_LEGS", (leg for pair in PAIRS for leg in pair)),
        )
    )


def _cells(pack: Battery | None) -> list[str]:
    """Open-circuit voltage of the pack [V] over its state of charge."""
    if pack is None:
        return []
    voltage = [pack.series_cells * cell for cell in pack.voltage_table]
    tables = (("CELL_CHARGE", pack.charge_table), ("CELL_VOLTAGE", voltage))
    return [_array("scalar", name, map(float, table)) for name, table in tables]


def _buffers() -> str:
    floats = "\n".join(f"  scalar* {name};" for name in BUFFERS)
    return f"struct Buffers {{\n{floats}\n  const int* delay;\n}};"


def _drive_constants(engine: EngineModel) -> Mapping[str, np.ndarray]:
    """Every field of ``Drive`` in its order, one number per joint in policy order."""
    robot, motors, gear, stop = engine.robot, engine.robot.motors, engine.robot.gear, engine.robot.soft_stop
    i2t = engine.options.i2t
    peak = joint_torque(gear, saturate(motors, np.asarray(motors.peak_torque)))
    no_load = no_load_speed(motors, robot.bus_voltage) / np.asarray(gear.ratio)
    values = {
        "pole_pairs": motors.pole_pairs,
        "resistance": motors.stator_resistance,
        "inductance": motors.q_axis_inductance,
        "flux": motors.flux_linkage,
        "peak": motors.peak_torque,
        "saturation": np.asarray(motors.saturation) * float(engine.options.saturation),
        "ratio": gear.ratio,
        "log2_efficiency": np.log2(np.asarray(gear.efficiency)),
        "dry_friction": robot.dry_friction,
        "lower": robot.position_limits[:, 0] + stop.zone,
        "upper": robot.position_limits[:, 1] - stop.zone,
        "stop_stiffness": stop.stiffness,
        "stop_damping": stop.damping,
        "inverse_peak": 1.0 / np.asarray(peak),
        "inverse_no_load": 1.0 / np.asarray(no_load),
        "armature": robot.armature,
        "continuous": 1.0 if i2t is None else i2t.continuous_current,
        "decay": 0.0 if i2t is None else i2t_decay(i2t, motors, engine.options.loop_period),
    }
    shape = (len(robot.joint_names),)
    return {name: np.broadcast_to(np.asarray(value, dtype=float), shape) for name, value in values.items()}


def _drive_source(engine: EngineModel, algebra: Algebra) -> str:
    """``leg_drive(k, leg)``: the k-th motor of a leg; ``waist_drive()``."""
    constants, names = _drive_constants(engine), engine.robot.joint_names
    cases = []
    for index, link in enumerate(_driven_links(engine)):
        joints = [names.index(leg.links[link].joint) for leg in engine.tree.legs]
        fields = [_literal(algebra, values[joints]) for values in constants.values()]
        cases.append(f"  if (k == {index}) return Drive{{{', '.join(fields)}}};")
    body = "\n".join([*cases[:-1], cases[-1].replace(f"if (k == {len(cases) - 1}) ", "")])
    text = f"FUNCTION Drive leg_drive(int k, const scalar* leg) {{\n{body}\n}}"
    if engine.robot.waist is None:
        return text
    fields = [f"S({float(values[engine.robot.waist])!r})" for values in constants.values()]
    return text + f"\nFUNCTION Drive waist_drive() {{ return Drive{{{', '.join(fields)}}}; }}"


def _literal(algebra: Algebra, values: np.ndarray) -> str:
    """A number, or an entry of the legs' table where legs differ."""
    if np.allclose(values, values[0], rtol=1e-13, atol=0.0):
        return f"S({float(values[0])!r})"
    return algebra.leg_constant(values)
