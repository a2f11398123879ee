"""The methods side by side: the paper's Table II and ours, interquartile means with their intervals."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from sprintlab.commands import CurriculumSchedule
from sprintlab.evaluation.clock import CLOCKS
from sprintlab.evaluation.estimates import merge_bands
from sprintlab.evaluation.quantities import number as number_text
from sprintlab.evaluation.results import EstimateBand
from sprintlab.training.methods import ALL_METHODS, LITERAL_ACS
from studies.paper.paper import PAPER_TABLE, REFERENCE_METHOD
from studies.paper.record import (
    COLLAPSE_SPEED,
    EvaluationRecord,
    Numbers,
    SearchRecord,
    SprintRecord,
    number,
    plain,
)
from studies.paper.statistics import Interval, improvement, interquartile_mean

Records = Mapping[str, Sequence[EvaluationRecord]]


@dataclass(frozen=True, kw_only=True)
class MethodRow:
    """One method over its seeds; collapsed seeds count in ``collapsed`` and nowhere else.

    Attributes:
        method: its name.
        seeds: number of policies.
        collapsed: how many of them collapsed.
        most_held: raw command, the most that is held at any v* that was passed [m/s].
        reference_faster: probability that a seed of the reference method holds more, raw.
        max_velocity: raw, held at the highest v* that was passed [m/s].
        most_held_self_paced: [m/s].
        peak_speed: 0.5 s mean, raw [m/s].
        angular_cost: J where most is held, raw [rad^2/s].
        normalized_cost: J over that of the reference method.
        common_cost: J at the speed that every method's policies passed [rad^2/s].
        sprint_time: raw [s], over the seeds that reached the line.
        sprint_time_self_paced: [s], likewise.
        cost_of_transport: where most is held, raw.
        falls: in those trials, mean over the seeds.
        audit_passed: how many seeds passed the audit in those trials.
        credible: how many did, or failed in nothing but a policy clock that is harmless.
        duty_factor: mean share of time that a foot is on the ground, likewise.
        hip_limited: share of time that a hip's motor is on its limit, mean of four, likewise.
        knee_limited: the same of the knees.
    """

    method: str
    seeds: int
    collapsed: int
    most_held: Interval
    reference_faster: Interval
    max_velocity: Interval
    most_held_self_paced: Interval
    peak_speed: Interval
    angular_cost: Interval
    normalized_cost: Interval
    common_cost: Interval
    sprint_time: Interval
    sprint_time_self_paced: Interval
    cost_of_transport: Interval
    falls: Interval
    audit_passed: int
    credible: int
    duty_factor: Interval
    hip_limited: Interval
    knee_limited: Interval


def collapsed(record: EvaluationRecord) -> bool:
    """Whether a policy cannot run, judged by the raw command."""
    return record.raw.collapsed


def common_speed(records: Sequence[EvaluationRecord]) -> float | None:
    """The highest v* that every policy passed and was tried at, collapsed ones left out [m/s].

    ``None`` when there is none.
    """
    passed = [
        {speed.top_speed for speed in record.raw.speeds if speed.top_speed <= best.top_speed}
        for record in records
        if not collapsed(record) and (best := record.raw.best) is not None
    ]
    return max(set.intersection(*passed), default=None) if passed else None


def method_rows(records: Records, reference: str = REFERENCE_METHOD) -> list[MethodRow]:
    """One row a method, in the order given.

    Args:
        records: method name to the evaluations of its seeds.
        reference: the method whose J is 1; ``normalized_cost`` is undefined where it is missing.
    """
    running = [record for group in records.values() for record in group]
    common = common_speed(running)
    unit = interquartile_mean(
        [record.raw.angular_cost for record in _running(records.get(reference, ()))]
    ).center
    fastest = _speeds(records.get(reference, ()))
    return [_row(method, group, unit, common, fastest) for method, group in records.items()]


def _speeds(group: Sequence[EvaluationRecord]) -> list[float]:
    """The most that every seed holds, raw [m/s]; 0 of one that collapsed."""
    return [0.0 if collapsed(record) else record.raw.most_held for record in group]


def _running(group: Sequence[EvaluationRecord]) -> list[EvaluationRecord]:
    return [record for record in group if not collapsed(record)]


def _row(
    method: str,
    group: Sequence[EvaluationRecord],
    unit: float,
    common: float | None,
    reference: Sequence[float],
) -> MethodRow:
    running = _running(group)
    best = [speed for record in running if (speed := record.raw.fastest) is not None]
    return MethodRow(
        method=method,
        seeds=len(group),
        collapsed=len(group) - len(running),
        most_held=interquartile_mean([record.raw.most_held for record in running]),
        reference_faster=improvement(reference, _speeds(group)),
        max_velocity=interquartile_mean([record.raw.max_velocity for record in running]),
        most_held_self_paced=interquartile_mean([record.self_paced.most_held for record in running]),
        peak_speed=interquartile_mean([record.raw.peak_speed for record in running]),
        angular_cost=interquartile_mean([record.raw.angular_cost for record in running]),
        normalized_cost=interquartile_mean(
            [record.raw.angular_cost / unit if unit else math.nan for record in running]
        ),
        common_cost=interquartile_mean([_cost_at(record, common) for record in running]),
        sprint_time=interquartile_mean([_time(record.sprint) for record in running]),
        sprint_time_self_paced=interquartile_mean([_time(record.sprint_self_paced) for record in running]),
        cost_of_transport=interquartile_mean([number(speed.cost_of_transport) for speed in best]),
        falls=interquartile_mean([speed.falls for speed in best]),
        audit_passed=sum(record.raw.audit_passed for record in running),
        credible=sum(record.credible for record in running),
        duty_factor=interquartile_mean([_mean(speed.duty_factor) for speed in best]),
        hip_limited=interquartile_mean([_mean(speed.envelope_share[1::3]) for speed in best]),
        knee_limited=interquartile_mean([_mean(speed.envelope_share[2::3]) for speed in best]),
    )


def _mean(values: Numbers) -> float:
    """Over feet or joints; ``nan`` where it is not defined."""
    return sum(number(value) for value in values) / len(values) if values else math.nan


def _cost_at(record: EvaluationRecord, top_speed: float | None) -> float:
    speed = None if top_speed is None else record.raw.at(top_speed)
    return math.nan if speed is None else number(speed.angular_cost)


def _time(sprint: SprintRecord | None) -> float:
    return math.nan if sprint is None else number(sprint.time)


TABLE_COLUMNS = (
    "method",
    "motor in training",
    "commands",
    "paper: speed",
    "ours: most held",
    "sprint faster",
    "paper: J_norm",
    "ours: J_norm",
    "100 m",
    "seeds",
    "audit",
)
"""Headings of ``table_cells``; speeds in m/s, times in s, raw command."""


def table_cells(row: MethodRow) -> tuple[str, ...]:
    """A row of the paper's Table II beside ours, as text under ``TABLE_COLUMNS``."""
    paper = PAPER_TABLE.get(row.method)
    actuator, commands = switches(row.method) if paper is None else (paper.actuator, paper.commands)
    return (
        row.method,
        actuator,
        commands,
        "-" if paper is None else _paper_text(paper.max_velocity, 1),
        velocity_text(row, row.most_held),
        "-" if row.method == REFERENCE_METHOD else row.reference_faster.text(2),
        "-" if paper is None else _paper_text(paper.normalized_cost, 3),
        row.normalized_cost.text(3),
        row.sprint_time.text(2),
        str(row.seeds),
        _audit_text(row),
    )


_ACTUATORS = {"simplified-dc": "v_d = 0", "flux-weakening": "flux weakening"}
_COMMANDS = {
    "AdaptiveSchedule": "adaptive",
    "UniformSchedule": "uniform",
    "FixedAccelerationSchedule": "fixed acceleration",
    "RampedSchedule": "uniform, ramp of 1 s",
    "BoxGrid": "box-adaptive grid",
    "ProgressGrid": "learning progress",
    "PredictionGrid": "predicted reward",
}


def switches(method: str) -> tuple[str, str]:
    """Motor in training and commands of a method outside the paper's table; dashes of an unknown one."""
    found = ALL_METHODS.get(method)
    if found is None:
        return "-", "-"
    motor = _ACTUATORS.get(found.actuator_model, found.actuator_model)
    motor = "network" if found.network else motor + ("" if found.saturation else ", no saturation")
    motor += "" if found.battery is None else " + battery"
    curriculum = isinstance(found.schedule, CurriculumSchedule)
    commands = _COMMANDS[type(found.schedule.targets.grid if curriculum else found.schedule).__name__]
    return motor, commands + (", literal" if method == LITERAL_ACS else "")


def _audit_text(row: MethodRow) -> str:
    """How many seeds passed, and how many more would but for a policy clock that is harmless."""
    if not row.seeds:
        return "-"
    more = row.credible - row.audit_passed
    return f"{row.audit_passed} of {row.seeds}" + (f", {more} but for the clock" if more else "")


def _paper_text(value: float | None, digits: int) -> str:
    return "collapse" if value is None else f"{value:.{digits}f}"


def velocity_text(row: MethodRow, velocity: Interval) -> str:
    """The speed, or that the method collapsed, or how many of its seeds did."""
    if not row.seeds:
        return "-"
    if row.collapsed == row.seeds:
        return "collapse"
    note = f" ({row.collapsed} of {row.seeds} collapsed)" if row.collapsed else ""
    return velocity.text(2) + note


def order_text(rows: Sequence[MethodRow]) -> str:
    """The methods by speed, in the paper and here; empty with fewer than two of ours."""
    ours = {row.method: row.most_held.center for row in rows if math.isfinite(row.most_held.center)}
    paper = {method: speed for method, row in PAPER_TABLE.items() if (speed := row.max_velocity) is not None}
    if len(ours) < 2:
        return ""
    return f"By speed: in the paper {_by_speed(paper)}; ours {_by_speed(ours)}."


def _by_speed(speeds: Mapping[str, float]) -> str:
    """Names, fastest first; an equals sign between those that are equally fast."""
    names = sorted(speeds, key=lambda name: -speeds[name])
    text = names[0]
    for before, name in pairwise(names):
        text += f" {'=' if speeds[name] == speeds[before] else '>'} {name}"
    return text


DETAIL_COLUMNS = (
    "method",
    "held at the highest v*",
    "peak 0.5 s",
    "J",
    "J at the common speed",
    "cost of transport",
    "duty factor",
    "falls of 10",
    "hip on its limit",
    "knee on its limit",
    "self-paced: most held",
    "self-paced: 100 m",
)
"""Headings of ``detail_cells``; with the raw command where they do not say otherwise."""


def detail_cells(row: MethodRow) -> tuple[str, ...]:
    """What stands behind a row, as text under ``DETAIL_COLUMNS``."""
    return (
        row.method,
        row.max_velocity.text(2),
        row.peak_speed.text(2),
        row.angular_cost.text(2),
        row.common_cost.text(2),
        row.cost_of_transport.text(2),
        row.duty_factor.text(2),
        row.falls.text(1),
        row.hip_limited.text(2),
        row.knee_limited.text(2),
        row.most_held_self_paced.text(2),
        row.sprint_time_self_paced.text(2),
    )


SEED_COLUMNS = (
    "method",
    "seed",
    "v* raw",
    "max velocity raw",
    "fastest raw",
    "v* self-paced",
    "max velocity self-paced",
    "fastest self-paced",
    "J",
    "100 m raw",
    "100 m self-paced",
    "steps [million]",
    "audit",
)
"""Headings of ``seed_cells``."""


def seed_cells(record: EvaluationRecord) -> tuple[str, ...]:
    """One policy, as text under ``SEED_COLUMNS``."""
    fastest = record.raw.fastest
    failed = [] if fastest is None else fastest.audit.items
    marks = ", ".join(item.name for item in failed if not item.passed)
    marks += " (harmless)" if marks and record.credible else ""
    return (
        record.method,
        str(record.seed),
        *_search_cells(record.raw),
        *_search_cells(record.self_paced),
        number_text(record.raw.angular_cost, 2),
        _sprint_text(record.sprint),
        _sprint_text(record.sprint_self_paced),
        f"{float(record.training.get('environment_steps', 'nan')) / 1e6:.0f}",
        "-" if fastest is None else marks or "passed",
    )


def _sprint_text(sprint: SprintRecord | None) -> str:
    """The time, and whether the run ended in a fall all the same: behind the line, where there is a time."""
    fell = sprint is not None and sprint.fell
    return number_text(_time(sprint), 2) + (", fell" if fell else "")


def _search_cells(search: SearchRecord) -> tuple[str, str, str]:
    best, fastest = search.best, search.fastest
    if best is None or fastest is None:
        return "-", "-", "-"
    most = f"{number_text(number(fastest.held_speed), 2)} at {fastest.top_speed:g}"
    return f"{best.top_speed:g}", number_text(search.max_velocity, 2), most


CLOCK_COLUMNS = (
    "method",
    "seed",
    "v*",
    "policy steps a stride",
    "stride follows the clock [%]",
    "held at 50 Hz",
    "at 48 Hz",
    "at 52 Hz",
    "at 50 Hz ± 10 %",
    "completed",
)
"""Headings of ``clock_cells``; speeds in m/s."""


def clock_cells(record: EvaluationRecord) -> tuple[str, ...]:
    """One policy with every clock, as text under ``CLOCK_COLUMNS``; the clocks are those of ``CLOCKS``."""
    clock = record.clock
    if clock is None or len(clock.entries) != len(CLOCKS):
        return (record.method, str(record.seed), *("-" for _ in CLOCK_COLUMNS[2:]))
    own = clock.entries[0]
    frequency = number(own.stride_frequency)
    return (
        record.method,
        str(record.seed),
        f"{clock.top_speed:g}",
        number_text(own.rate / frequency if frequency else math.nan, 2),
        number_text(100 * number(clock.followed), 0),
        *(number_text(number(entry.held_speed), 2) for entry in clock.entries),
        ", ".join(str(entry.completed) for entry in clock.entries) + f" of {own.trials}",
    )


def method_estimates(group: Sequence[EvaluationRecord]) -> tuple[EstimateBand, ...]:
    """Errors of a method's estimates in the raw trials at each seed's fastest speed, all seeds together."""
    fastest = [speed for record in group if (speed := record.raw.fastest) is not None]
    return merge_bands(band for speed in fastest for band in speed.estimate)


def table_numbers(records: Records) -> dict[str, Any]:
    """The table as JSON-ready values: an interquartile mean and the ends of its interval for every number."""
    everything = [record for group in records.values() for record in group]
    return {
        "common_speed_m_s": common_speed(everything),
        "collapse_below_m_s": COLLAPSE_SPEED,
        "methods": {row.method: _row_numbers(row) for row in method_rows(records)},
    }


def _row_numbers(row: MethodRow) -> dict[str, Any]:
    paper = PAPER_TABLE.get(row.method)
    values: dict[str, Any] = {
        "paper_max_velocity_m_s": None if paper is None else paper.max_velocity,
        "paper_J_norm": None if paper is None else paper.normalized_cost,
    }
    for name, value in vars(row).items():
        if isinstance(value, Interval):
            values[name] = {key: plain(end) for key, end in vars(value).items()}
        elif name != "method":
            values[name] = value
    return values
