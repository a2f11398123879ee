"""The words and tables of a race's report: sentences are computed, so that they say what happened."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from sprintlab.evaluation.audit import CLOCK_ITEM
from sprintlab.evaluation.quantities import Quantity, number
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
from sprintlab.evaluation.second_engine import (
    ENGINE_NAMES,
    ENGINE_STEPS,
    comparison_sentence,
    engine_rows,
    first_engine,
    mark,
)
from sprintlab.evaluation.trial import STALL_TIME, STALL_WAY
from sprintlab.robots import RobotDescription

LANE_MARK = "left its lane"
"""The mark of a time that was run outside the lane."""


def sprint_text(sprint: SprintResult) -> str:
    """Time of a sprint with the mark of a lane that was left, or the reason that it did not finish."""
    if sprint.stalled:
        return f"given up: {stall_text(sprint)}"
    if not sprint.finished:
        return "not finished"
    return f"{number(sprint.time)} ({LANE_MARK})" if sprint.left_lane else number(sprint.time)


def stall_text(sprint: SprintResult) -> str:
    """Where a robot stood that got nowhere."""
    return (
        f"less than {STALL_WAY:g} m in {STALL_TIME:g} s, {sprint.trial.metrics.distance:.1f} m from the start"
    )


def fall_text(trial: TrialResult) -> str:
    """When and why a robot fell, which drives had fallen back by then, and the lowest bus voltage."""
    metrics, parts = trial.metrics, [f"fell at {trial.fall_time or 0.0:.1f} s ({trial.fall_reason})"]
    if metrics.i2t_full:
        full = ", ".join(f"{joint} at {moment:.1f} s" for joint, moment in metrics.i2t_full)
        parts.append(f"I²t full: {full}")
    if metrics.lowest_bus_voltage is not None and metrics.lowest_bus_time is not None:
        parts.append(f"bus down to {metrics.lowest_bus_voltage:.1f} V at {metrics.lowest_bus_time:.1f} s")
    return "; ".join(parts)


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
        number, _, unit = worst.partition(" ")
        median += f", worst {number if median.partition(' ')[2] == unit else worst}"
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


@dataclass(frozen=True, kw_only=True)
class ResultRow:
    """One line of the table of results, mean and standard deviation over the trials that completed."""

    name: str
    raw: str
    self_paced: str
    unit: str
    meaning: str


def result_rows(result: RaceResult) -> Iterator[ResultRow]:
    """The table of results, raw beside self-paced."""
    yield ResultRow(
        name=f"time over {result.sprint.distance:g} m",
        raw=sprint_text(result.sprint),
        self_paced=sprint_text(result.sprint_self_paced),
        unit="s",
        meaning="one run each, nominal friction and payload",
    )
    for item in QUANTITIES:
        raw, paced = (_with_spread(group, item) for group in (result.raw, result.self_paced))
        yield ResultRow(name=item.name, raw=raw, self_paced=paced, unit=item.unit, meaning=item.meaning)
    raw, paced = (f"{group.falls} of {len(group.trials)}" for group in (result.raw, result.self_paced))
    yield ResultRow(name="falls", raw=raw, self_paced=paced, unit="", meaning="trials that fell")
    raw, paced = (f"{group.not_stopped} of {len(group.trials)}" for group in (result.raw, result.self_paced))
    meaning = f"trials that were not below {REST_SPEED:g} m/s in the last second"
    yield ResultRow(name="did not stop", raw=raw, self_paced=paced, unit="", meaning=meaning)
    yield from _battery_row(result)


def _battery_row(result: RaceResult) -> Iterator[ResultRow]:
    """Held speed of one raw trial on battery and warm windings."""
    if result.battery is None:
        return
    metrics = result.battery.metrics
    ends = f"bus down to {metrics.lowest_bus_voltage:.1f} V, windings up to {metrics.hottest_winding:.0f} °C"
    yield ResultRow(
        name="held speed on battery and warm windings",
        raw=number(metrics.held_speed, 2),
        self_paced="",
        unit="m/s",
        meaning=f"one nominal trial; {ends}",
    )


def spread(group: SpeedResult, field: str) -> float:
    """Standard deviation over the completed trials; ``nan`` for fewer than two."""
    values = [getattr(trial.metrics, field) for trial in group.completed]
    return float(np.std(values, ddof=1)) if len(values) > 1 else float("nan")


def _with_spread(group: SpeedResult, item: Quantity) -> str:
    mean, deviation = (
        number(value, item.digits) for value in (group.mean(item.field), spread(group, item.field))
    )
    return mean if "-" in (mean, deviation) else f"{mean} ± {deviation}"


def summary(result: RaceResult, robot: RobotDescription) -> list[str]:
    """What a reader in a hurry must know, one sentence a point; nothing is said that was not measured."""
    return [
        _sprint_sentence(result),
        *_speed_sentences(result),
        *_stop_sentences(result),
        *_engine_sentences(result),
        *_motor_sentences(result, robot),
        _audit_sentence(result),
    ]


def engine_table(result: RaceResult) -> dict[str, Any] | None:
    """Both engines side by side: their names and the rows; ``None`` where there is only one."""
    if result.second_engine is None:
        return None
    both = first_engine(result), result.second_engine
    return {"names": [ENGINE_NAMES[run.engine] for run in both], "rows": list(engine_rows(*both))}


def engine_fault(result: RaceResult) -> str:
    """What the second engine has against the speeds; empty where nothing, or where it was not asked."""
    if result.second_engine is None:
        return ""
    found = mark(result.raw, result.second_engine.raw)
    return f"second engine, {ENGINE_NAMES[result.second_engine.engine]}: {found}" if found else ""


def _engine_sentences(result: RaceResult) -> Iterator[str]:
    if result.second_engine is not None:
        yield comparison_sentence(first_engine(result), result.second_engine)


def _sprint_sentence(result: RaceResult) -> str:
    raw, paced = result.sprint, result.sprint_self_paced
    ways = [
        f"in {sprint.time:.2f} s {way}" + (f" ({LANE_MARK})" if sprint.left_lane else "")
        for sprint, way in ((raw, "with the raw command"), (paced, "self-paced"))
        if sprint.finished
    ]
    start = f"{result.robot.upper()} ({result.mass:.1f} kg)"
    if raw.stalled and paced.stalled:
        return f"{start} gets nowhere: {stall_text(raw)}; the race was given up."
    if not ways:
        return f"{start} did not finish the {raw.distance:g} m."
    return f"{start} ran {raw.distance:g} m {' and '.join(ways)}."


def _speed_sentences(result: RaceResult) -> Iterator[str]:
    raw, trials = result.raw, len(result.raw.trials) + len(result.self_paced.trials)
    yield f"{raw.falls + result.self_paced.falls} of {trials} seeded trials fell."
    held = raw.mean("held_speed")
    if np.isfinite(held):
        gap = result.top_speed - held
        yield (
            f"Asked for {result.top_speed:g} m/s it holds {held:.2f} m/s, "
            + (f"{gap:.2f} m/s short of the command" if gap > 0.05 else "as commanded")
            + (f"; {steady}." if (steady := steady_text(raw)) else ".")
        )


def _stop_sentences(result: RaceResult) -> Iterator[str]:
    """Whether it obeys the command to stop."""
    for way, group in (("the raw command", result.raw), ("the self-paced command", result.self_paced)):
        upright = [trial for trial in group.trials if not trial.fall_reason]
        speed = max((trial.metrics.final_speed for trial in upright), default=0.0)
        if speed > REST_SPEED:
            yield f"At the end of {way}, which asks it to stand, it still moves at {speed:.1f} m/s."


def _motor_sentences(result: RaceResult, robot: RobotDescription) -> Iterator[str]:
    raw = result.raw
    if not raw.completed:
        return
    share = np.asarray(raw.mean("envelope_share"), dtype=float)
    busiest = robot.joint_names[int(share.argmax())].replace("_", " ")
    yield f"The busiest motor, {busiest}, sits on its torque limit for {100 * share.max():.0f} % of the time."
    drawn, copper = raw.mean("electrical_power"), raw.mean("copper_power")
    if np.isfinite(drawn) and drawn > 0.0:
        yield (
            f"At speed the motors draw {drawn / 1e3:.1f} kW from the bus; {copper / 1e3:.1f} kW become heat "
            "in the windings."
        )


def _audit_sentence(result: RaceResult) -> str:
    failed = [audit_failure(item) for item in result.audit.failed]
    if failed:
        return f"The exploit audit failed ({'; '.join(failed)}): the speeds are not to be trusted."
    return "Every check of the exploit audit passed."


def setup_rows(result: RaceResult, robot: RobotDescription) -> Iterator[tuple[str, str]]:
    """With what it was run: robot, motors, plant, trials."""
    limits = np.unique(np.asarray(robot.motors.peak_torque, dtype=float))
    ratios = np.unique(np.asarray(robot.gear.ratio, dtype=float))
    yield "robot", f"{robot.name}, {robot.total_mass:.1f} kg, {len(robot.joint_names)} motors"
    yield (
        "motors",
        f"peak torque {_list(limits)} N m, gear ratio {_list(ratios)}, {robot.bus_voltage:g} V bus",
    )
    yield "policy", f"{result.policy}, 50 Hz"
    yield "plant", f"{ENGINE_STEPS[result.engine]}, 1 kHz motor loop, refined motor model"
    yield (
        "trials",
        f"{len(result.raw.trials)} with the raw command and {len(result.self_paced.trials)} self-paced, "
        f"command up to {result.top_speed:g} m/s, {result.raw.required} must complete",
    )
    yield "computing time", f"{result.wall_time:.0f} s"


def _list(values: np.ndarray) -> str:
    return " and ".join(f"{value:g}" for value in values)
