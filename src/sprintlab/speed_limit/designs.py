"""Designs of a robot's drives at fixed mass: gears and winding, their speed limits, and which design wins.

A designer believes a motor model. One who leaves the d-axis voltage out (``simplified-dc``, v_d = 0) believes
other limits than the refined motor has, and may choose another design; the refined motor judges both.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from sprintlab.core.checks import check_positive, check_range
from sprintlab.core.errors import InvalidValueError
from sprintlab.core.files import atomic_write_text
from sprintlab.motors import MotorModel, WindingHeat, warmed
from sprintlab.robots import ParameterRow, RobotDescription, drive_quantity
from sprintlab.robots.description import JOINTS_PER_LEG
from sprintlab.robots.importing.table import table_text
from sprintlab.speed_limit.analysis import stride_facts
from sprintlab.speed_limit.runner import runner_from_robot
from sprintlab.speed_limit.search import Fastest, SearchSettings, fastest_stride
from sprintlab.speed_limit.stride import evaluate

MODELS: tuple[MotorModel, MotorModel] = ("refined", "simplified-dc")
"""The motor model that judges, and the one whose choices are judged."""
GEARS = {f"gear.{joint}": joint for joint in JOINTS_PER_LEG}
WINDING = "winding"
QUANTITIES = (*GEARS, WINDING)
"""What can be varied: the gear ratio of a joint, and the turns of all windings over the robot's own."""
POWERS = {"flux_linkage": 1, "stator_resistance": 2, "q_axis_inductance": 2}
"""How a motor's parameters follow the turns at the same copper: psi ~ n, R and L ~ n^2."""
RUN_SECONDS = 10.0
"""How long the windings are warmed from 25 degC before their temperature is told: the protocol's hold [s]."""
MOST_DESIGNS = 10_000

Design = Mapping[str, float]
"""Names in ``QUANTITIES`` to their values."""


def parse_variations(texts: Sequence[str]) -> dict[str, tuple[float, ...]]:
    """``["gear.hip=6:11:6", "winding=0.8,1"]`` as values by name.

    Args:
        texts: each ``NAME=LOW:HIGH``, which is six values, ``NAME=LOW:HIGH:COUNT`` or ``NAME=VALUE,VALUE``;
            names in ``QUANTITIES``.

    Raises:
        InvalidValueError: another form, an unknown name, or a value that is not positive.
    """
    return dict(map(_parse_variation, texts))


def _parse_variation(text: str) -> tuple[str, tuple[float, ...]]:
    name, _, values = text.partition("=")
    try:
        if ":" in values:
            low, high, *count = values.split(":")
            (number,) = map(int, count or [6])
            found = np.linspace(float(low), float(high), number).round(6).tolist()
        else:
            found = [float(value) for value in values.split(",")]
    except ValueError as error:
        allowed = "must be NAME=LOW:HIGH, NAME=LOW:HIGH:COUNT or NAME=VALUE,VALUE"
        raise InvalidValueError("vary", text, allowed) from error
    if name not in QUANTITIES or not found:
        raise InvalidValueError("vary", text, f"needs a value, and a name of {', '.join(QUANTITIES)}")
    check_positive(f"vary {name}", np.asarray(found))
    return name, tuple(found)


def all_designs(variations: Mapping[str, Sequence[float]]) -> list[dict[str, float]]:
    """Every combination of the values.

    Raises:
        InvalidValueError: nothing is varied, or there are more than ``MOST_DESIGNS``.
    """
    if not variations:
        raise InvalidValueError("vary", (), f"needs at least one of {', '.join(QUANTITIES)}")
    check_range("designs", float(np.prod([len(values) for values in variations.values()])), 1, MOST_DESIGNS)
    return [dict(zip(variations, values, strict=True)) for values in itertools.product(*variations.values())]


def design_name(design: Design) -> str:
    """``gear.hip=7,winding=0.8``."""
    return ",".join(f"{name}={value:g}" for name, value in design.items())


def redesigned(
    rows: Mapping[str, ParameterRow], design: Design, most_current: float | None = None
) -> dict[str, ParameterRow]:
    """The rows of a robot's table with the gears and the winding of a design; masses stay as they are.

    Args:
        rows: rows of the robot's own table, by quantity.
        design: what is varied.
        most_current: greatest phase current of the inverters [A]: a winding that needs more for its peak
            torque loses the rest of it. None: every winding gets the current that it needs.
    """
    changed = dict(rows)
    for name, joint in GEARS.items():
        if name in design:
            _put(changed, rows[drive_quantity(rows, joint, "gear_ratio")], joint, "gear_ratio", design[name])
    turns = design.get(WINDING, 1.0)
    for quantity, row in rows.items():
        field = quantity.rpartition(".")[2]
        if quantity.startswith("motor") and field in POWERS:
            changed[quantity] = replace(row, value=_number(row) * turns ** POWERS[field], basis="designed")
    if most_current is not None:
        for joint in JOINTS_PER_LEG:
            _limit_current(changed, joint, most_current)
    return changed


def _put(rows: dict[str, ParameterRow], row: ParameterRow, joint: str, field: str, value: float) -> None:
    quantity = f"motor.{joint}.{field}"
    rows[quantity] = replace(row, quantity=quantity, value=value, basis="designed")


def _number(row: ParameterRow) -> float:
    assert isinstance(row.value, float)
    return row.value


def _limit_current(rows: dict[str, ParameterRow], joint: str, most: float) -> None:
    """Cut a motor's peak torque; the iron saturates at the torque at which it did before."""
    found = {
        field: rows[drive_quantity(rows, joint, field)]
        for field in ("pole_pairs", "flux_linkage", "peak_torque", "saturation")
    }
    share = 1.5 * _number(found["pole_pairs"]) * _number(found["flux_linkage"]) * most
    share /= _number(found["peak_torque"])
    if share < 1.0:
        for field in ("peak_torque", "saturation"):
            _put(rows, found[field], joint, field, share * _number(found[field]))


def write_robot(path: Path, name: str, rows: Mapping[str, ParameterRow], source: str) -> None:
    """Write a robot's table, from which everything else can be made: ``limit``, ``train``, ``evaluate``.

    Raises:
        SprintlabError: the disk refuses.
    """
    atomic_write_text(path, table_text(name, rows, source))


def peak_current(robot: RobotDescription) -> float:
    """Phase current at which hip or knee gives its peak torque, the greater of both [A]."""
    motors = runner_from_robot(robot).motors
    return float(np.max(np.asarray(motors.peak_torque) / np.asarray(motors.torque_constant)))


def design_limit(
    robot: RobotDescription, model: MotorModel, settings: SearchSettings, near: Sequence[Fastest] = ()
) -> tuple[Fastest, dict[str, float]]:
    """The speed limit of a robot under a motor model, and what its fastest stride takes.

    Args:
        robot: robot of the design.
        model: motor model.
        settings: how hard to search.
        near: strides of similar robots, to begin with.

    Returns:
        The stride; speed, spread of the search [m/s], power from the bus [W] and temperature of the hottest
        winding after ``RUN_SECONDS`` [degC].
    """
    runner = replace(runner_from_robot(robot), motor_model=model)
    found = fastest_stride(runner, settings, near=near)
    facts = stride_facts(runner, evaluate(runner, found.parameters[None], found.speed), found.speed)
    numbers = {
        "speed_m_s": found.speed,
        "spread_m_s": found.spread,
        "power_W": facts.mechanical_power + facts.copper_loss,
        "winding_degC": float(np.max(warmed(WindingHeat(), 25.0, facts.hottest_loss, RUN_SECONDS))),
    }
    return found, numbers


@dataclass(frozen=True, kw_only=True)
class Choice:
    """Which design each motor model chooses, and what the refined motor says of both."""

    basis: str  # what the speeds are those of
    chosen: Mapping[str, Design]  # design by model
    believed: Mapping[str, float]  # speed that the model gives its design [m/s]
    judged: Mapping[str, Mapping[str, float]]  # numbers of that design by the refined motor
    noise: float  # how much a speed of the design that wins may change when it is found again [m/s]

    def cost(self, quantity: str) -> float:
        """What the choice of v_d = 0 has more than that of the refined motor, each at its own top speed."""
        judge, other = (self.judged[model] for model in MODELS)
        return other[quantity] - judge[quantity]

    def sentence(self) -> str:
        """Which designs are chosen, and what the wrong choice costs."""
        judge, other = (design_name(self.chosen[model]) for model in MODELS)
        top, believed = self.judged[MODELS[0]]["speed_m_s"], self.believed[MODELS[1]]
        loss = -self.cost("speed_m_s")
        both = f"By {self.basis} both motor models choose {judge}"
        if judge == other and not loss:
            return f"{both}, {top:.2f} m/s; v_d = 0 promises {believed:.2f} m/s."
        if judge == other:
            return (
                f"{both}: trained with the refined motor it holds {top:.2f} m/s, trained with v_d = 0 "
                f"{top - loss:.2f} m/s of the {believed:.2f} m/s that its designer expects."
            )
        least = (
            ""
            if loss > self.noise
            else f", less than the {self.noise:.2f} m/s by which one design's speeds differ"
        )
        return (
            f"By {self.basis} the refined motor chooses {judge}, {top:.2f} m/s; v_d = 0 chooses {other} "
            f"and believes {believed:.2f} m/s, of which the refined motor leaves {top - loss:.2f}: the wrong "
            f"choice costs {loss:.2f} m/s{least}, {self.cost('power_W'):+.0f} W and "
            f"{self.cost('winding_degC'):+.1f} degC."
        )


def choose(rows: Sequence[Mapping[str, Any]], trained: bool = False) -> Choice:
    """The choice of each motor model among designs, by what that model lets them run.

    Args:
        rows: of ``"design"``, and by model either ``"limits"`` or ``"trained"``.
        trained: choose by the policies that were trained under each motor model.
    """
    if trained:
        seeds = min(row["trained"][model]["seeds"] for row in rows for model in MODELS)
        counted = "one seed each" if seeds == 1 else f"{seeds} seeds each"
        key, basis, believed = "trained", f"trained policies ({counted})", "believed_m_s"
    else:
        key, basis, believed = "limits", "computed strides", "speed_m_s"
    best = {model: max(rows, key=lambda row: row[key][model][believed]) for model in MODELS}
    judged = {model: row[key][model if trained else MODELS[0]] for model, row in best.items()}
    return Choice(
        basis=basis,
        chosen={model: row["design"] for model, row in best.items()},
        believed={model: row[key][model][believed] for model, row in best.items()},
        judged=judged,
        noise=max(numbers["spread_m_s"] for numbers in judged.values()),
    )
