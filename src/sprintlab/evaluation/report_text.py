"""The words and tables of a race."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from sprintlab.core.text import number
from sprintlab.evaluation.audit import CLOCK_ITEM
from sprintlab.evaluation.quantities import Quantity
from sprintlab.evaluation.results import (
    QUANTITIES,
    REST_SPEED,
    AuditItem,
    AuditReport,
    RaceResult,
    SpeedResult,
    SprintResult,
    TrialResult,
)
from sprintlab.evaluation.second_engine import ENGINE_NAMES, ENGINE_STEPS, mark
from sprintlab.evaluation.trial import STALL_DISTANCE, STALL_TIME
from sprintlab.robots import RobotDescription

LANE_MARK = "left its lane"
"""The mark of a time that was run outside the lane."""


def sprint_text(sprint: SprintResult) -> str:
    """Time of a sprint with the mark of a lane that was left, or the reason that it did not finish."""
    if sprint.stalled:
        reached = sprint.trial.metrics.distance
        return f"given up: less than {STALL_DISTANCE:g} m in {STALL_TIME:g} s, {reached:.1f} m from the start"
    if not sprint.finished:
        return "not finished"
    return f"{number(sprint.time)} ({LANE_MARK})" if sprint.left_lane else number(sprint.time)


def fall_text(trial: TrialResult) -> str:
    """When and why a robot fell, whether a drive had fallen back by then, and the lowest bus voltage."""
    metrics, parts = trial.metrics, [f"fell at {trial.fall_time or 0.0:.1f} s ({trial.fall_reason})"]
    if (metrics.highest_i2t_level or 0.0) > 0.999:
        parts.append("I²t full")
    if metrics.lowest_bus_voltage is not None:
        parts.append(f"bus down to {metrics.lowest_bus_voltage:.1f} V")
    return "; ".join(parts)


def battery_text(trial: TrialResult) -> str:
    """Held speed of the trial on battery and warm windings, and what it ended at."""
    held, metrics = number(trial.metrics.held_speed, 2), trial.metrics
    if trial.fall_reason:
        return f"{held} ({fall_text(trial)})"
    return f"{held} (down to {metrics.lowest_bus_voltage:.1f} V, up to {metrics.hottest_winding:.0f} °C)"


def audit_value(value: float, unit: str) -> str:
    """A measured value or limit of the audit, with its unit; under 0.1 m or 0.1 s in mm or ms."""
    if not np.isfinite(value):
        return "-"
    if unit in ("m", "s") and abs(value) < 0.1:
        return f"{1e3 * value:.3g} m{unit}"
    return f"{value:.3g} {unit}".strip()


def audit_measured(item: AuditItem) -> str:
    """Median and, where it is another, worst of what was measured, and what the worst trial did."""
    median, worst = audit_value(item.value, item.unit), audit_value(item.worst, item.unit)
    if np.isfinite(item.worst) and worst != median:
        bare, _, unit = worst.partition(" ")
        median += f", worst {bare if median.partition(' ')[2] == unit else worst}"
    return median + (f" ({item.detail})" if item.detail and not item.passed else "")


def audit_limit(item: AuditItem) -> str:
    """The limit of one exploit, and from which side it bounds what was measured."""
    return f"{item.bound} {audit_value(item.threshold, item.unit)}"


def audit_failure(item: AuditItem) -> str:
    """What failed, in words: ``gear torque 6.8 x peak, worst 7.2: at most 3``."""
    value, limit = audit_value(item.value, item.unit), audit_value(item.threshold, item.unit)
    (_, _, unit), (bare, _, limit_unit) = value.partition(" "), limit.partition(" ")
    return f"{item.name} {audit_measured(item)}: {item.bound} {bare if unit == limit_unit else limit}"


def audit_verdict(audit: AuditReport) -> str:
    """What the audit says of the speeds; a gait timed by the clock is a question, not an answer."""
    failed = {item.name for item in audit.failed}
    if not failed:
        return "passed"
    if failed == {CLOCK_ITEM}:
        return "FAILED, by the clock alone: evaluate --clock-check tells whether it matters"
    return f"FAILED {len(failed)} of {len(audit.items)} checks: do not trust the speeds"


def steady_text(result: SpeedResult) -> str:
    """Whether the held speed was steady; empty where nothing was held."""
    if result.held_steady is None:
        return ""
    rise = result.mean("hold_acceleration")
    return "steady" if result.held_steady else f"not steady: still rising by {rise:.2f} m/s per second"


class ResultRow(NamedTuple):
    """One line of the table of results: mean ± standard deviation over the trials that completed."""

    name: str
    raw: str
    self_paced: str
    unit: str = ""
    meaning: str = ""


def result_rows(result: RaceResult) -> Iterator[ResultRow]:
    """The table of results of the terminal and of the report."""

    def row(name: str, text: Callable[[SpeedResult], str], unit: str = "", meaning: str = "") -> ResultRow:
        return ResultRow(name, text(result.raw), text(result.self_paced), unit, meaning)

    sprints = sprint_text(result.sprint), sprint_text(result.sprint_self_paced)
    time = f"time over {result.sprint.distance:g} m"
    yield ResultRow(time, *sprints, "s", "one run each, nominal friction and payload")
    for item in QUANTITIES:
        yield row(item.name, partial(_with_spread, item=item), item.unit, item.meaning)
    yield row("held steady", _steady, "", "rising by at most 0.1 m/s per second")
    yield row("falls", lambda group: f"{group.falls} of {len(group.trials)}", "", "trials that fell")
    slow = f"not below {REST_SPEED:g} m/s in the last second"
    yield row("did not stop", lambda group: f"{group.not_stopped} of {len(group.trials)}", "", slow)
    if result.battery is not None:
        held = battery_text(result.battery)
        yield ResultRow("held speed on battery, windings warm", held, "", "m/s", "one nominal trial")
    for which, pick in (("mean", np.mean), ("busiest", np.max)):
        name = f"time on the envelope, {which} joint"
        yield row(name, partial(_envelope_share, pick=pick), "%", "torque on its limit")
    if any(map(_i2t_level, (result.raw, result.self_paced))):
        yield row("I²t, highest level of all joints", _i2t_level, "%", "100: only continuous current")


def _steady(group: SpeedResult) -> str:
    return "-" if group.held_steady is None else "yes" if group.held_steady else "no"


def _envelope_share(group: SpeedResult, pick: Callable[..., Any]) -> str:
    return number(float(pick(100 * np.asarray(group.mean("envelope_share"), dtype=float))), 1)


def _i2t_level(group: SpeedResult) -> str:
    """The highest of a group's trials; empty without a limit by I²t."""
    levels = [trial.metrics.highest_i2t_level for trial in group.trials]
    known = [level for level in levels if level is not None]
    return f"{100.0 * max(known):.0f}" if known else ""


def _with_spread(group: SpeedResult, item: Quantity) -> str:
    mean = number(group.mean(item.field), item.digits)
    values = [getattr(trial.metrics, item.field) for trial in group.completed]
    deviation = number(float(np.std(values, ddof=1)), item.digits) if len(values) > 1 else "-"
    return mean if "-" in (mean, deviation) else f"{mean} ± {deviation}"


def engine_table(result: RaceResult) -> dict[str, Any] | None:
    """Both engines side by side: their names and the rows; ``None`` where there is only one."""
    second = result.second_engine
    if second is None:
        return None
    runs = (result, second)
    rows = [(f"time over {result.sprint.distance:g} m", *(sprint_text(run.sprint) for run in runs), "s")]
    rows += [
        (item.name, *(number(run.raw.mean(item.field), item.digits) for run in runs), item.unit)
        for item in QUANTITIES
    ]
    rows.append(("falls", *(f"{run.raw.falls} of {len(run.raw.trials)}" for run in runs), ""))
    return {"names": [ENGINE_NAMES[run.engine] for run in runs], "rows": rows}


def engine_fault(result: RaceResult) -> str:
    """What the second engine has against the speeds; empty where nothing, or where it was not asked."""
    if result.second_engine is None:
        return ""
    found = mark(result.raw, result.second_engine.raw)
    return f"second engine, {ENGINE_NAMES[result.second_engine.engine]}: {found}" if found else ""


def setup_rows(result: RaceResult, robot: RobotDescription) -> Iterator[tuple[str, str]]:
    """With what it was run: robot, motors, plant, trials."""
    limits, ratios = (
        " and ".join(f"{value:g}" for value in np.unique(np.asarray(values, dtype=float)))
        for values in (robot.motors.peak_torque, robot.gear.ratio)
    )
    yield "robot", f"{robot.name}, {robot.total_mass:.1f} kg, {len(robot.joint_names)} motors"
    yield "motors", f"peak torque {limits} N m, gear ratio {ratios}, {robot.bus_voltage:g} V bus"
    yield "policy", f"{result.policy}, 50 Hz"
    yield "plant", f"{ENGINE_STEPS[result.engine]}, 1 kHz motor loop, refined motor model"
    yield (
        "trials",
        f"{len(result.raw.trials)} with the raw command and {len(result.self_paced.trials)} self-paced, "
        f"command up to {result.top_speed:g} m/s, {result.raw.required} must complete",
    )
    yield "computing time", f"{result.wall_time:.0f} s"
