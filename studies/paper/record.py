"""What is kept of a policy's evaluation: plain numbers in ``evaluation.json``; ``null`` where undefined."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any, TypeVar

import msgspec
from msgspec import Meta

from sprintlab.core.errors import SprintlabError
from sprintlab.core.files import atomic_write_bytes
from sprintlab.core.reading import parse_json, read_bytes
from sprintlab.evaluation.audit import CLOCK_ITEM, audit_trials
from sprintlab.evaluation.clock_check import ClockCheck
from sprintlab.evaluation.estimates import merge_bands
from sprintlab.evaluation.results import AuditReport, EstimateBand, SpeedResult, SprintResult

FORMAT_VERSION = 1

HARMLESS_LOSS = 0.05
"""A gait that loses no more of its speed than this with any other clock does not live on its clock."""

COLLAPSE_SPEED = 2.0
"""A policy that holds less than this has learnt no running: it counts as collapsed [m/s]."""

RECORD_LIMIT = 4 << 20
"""Largest record that is read [bytes]; those of the study have 0.1 MB."""
_LARGEST = 1e12  # of any number

Number = float | None
Numbers = tuple[Number, ...]
Count = Annotated[int, Meta(ge=0)]
# These stand on a page and on a terminal, which obey some signs instead of showing them.
MethodName = Annotated[str, Meta(pattern=r"\A[\w.+-]{1,60}\Z")]
ItemName = Annotated[str, Meta(pattern=r"\A[\w' -]{1,80}\Z")]


class AuditEntry(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One item of the exploit audit; ``value`` is ``null`` where it is not defined."""

    name: ItemName
    value: Number
    unit: str
    threshold: float
    passed: bool


class AuditRecord(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The exploit audit, item by item."""

    items: tuple[AuditEntry, ...]

    @property
    def passed(self) -> bool:
        """Whether every item passed."""
        return all(item.passed for item in self.items)


class SpeedRecord(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The seeded trials of one v*: means over those that completed.

    Attributes:
        top_speed: v* [m/s].
        trials: how many ran; a speed that fails is given up at the fall that decides it.
        falls: how many of them fell.
        passed: whether enough completed.
        held_speed: [m/s].
        peak_speed: 0.5 s mean [m/s].
        angular_cost: J [rad^2/s].
        lateral_deviation: [m].
        cost_of_transport: electrical.
        electrical_power: [W].
        stride_frequency: [Hz].
        duty_factor: of each foot (4).
        envelope_share: share of time of each joint on its motor's limit (12).
        audit: the exploit audit over the trials that completed.
        estimate: errors of the policy's estimate by speed; empty without an estimator.
    """

    top_speed: float
    trials: Count
    falls: Count
    passed: bool
    held_speed: Number
    peak_speed: Number
    angular_cost: Number
    lateral_deviation: Number
    cost_of_transport: Number
    electrical_power: Number
    stride_frequency: Number
    duty_factor: Numbers
    envelope_share: Numbers
    audit: AuditRecord
    estimate: tuple[EstimateBand, ...] = ()

    def __post_init__(self) -> None:
        if any(band.samples < 1 for band in self.estimate):
            raise ValueError("a band of the estimate has no samples")


class SearchRecord(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The search for the highest speed, one way of giving the command.

    Attributes:
        speeds: every v* tried, rising.
    """

    speeds: tuple[SpeedRecord, ...]

    @property
    def best(self) -> SpeedRecord | None:
        """The highest v* before the first that failed; ``None`` when the first one failed."""
        best = None
        for speed in self.speeds:
            if not speed.passed:
                break
            best = speed
        return best

    @property
    def fastest(self) -> SpeedRecord | None:
        """The v* up to the best one at which most speed was held; asked for more, a policy may give less."""
        best = self.best  # once: it goes through all of them, of which a stranger's file may hold thousands
        passed = [speed for speed in self.speeds if best and speed.top_speed <= best.top_speed]
        return max(passed, key=lambda speed: number(speed.held_speed), default=None)

    def at(self, top_speed: float) -> SpeedRecord | None:
        """The trials at one v* [m/s]; ``None`` when it was not tried."""
        return next((speed for speed in self.speeds if abs(speed.top_speed - top_speed) < 1e-9), None)

    @property
    def max_velocity(self) -> float:
        """Mean held speed at the best v* [m/s]; ``nan`` when nothing passed."""
        return math.nan if self.best is None else number(self.best.held_speed)

    @property
    def most_held(self) -> float:
        """The most that is held, at the fastest v* [m/s]; ``nan`` when nothing passed.

        A policy that is asked for more than it can run may slow down and still complete: then this is more
        than ``max_velocity``.
        """
        return math.nan if self.fastest is None else number(self.fastest.held_speed)

    @property
    def peak_speed(self) -> float:
        """Mean 0.5 s peak at the fastest v* [m/s]; ``nan`` when nothing passed."""
        return math.nan if self.fastest is None else number(self.fastest.peak_speed)

    @property
    def angular_cost(self) -> float:
        """J at the fastest v* [rad^2/s]; ``nan`` when nothing passed."""
        return math.nan if self.fastest is None else number(self.fastest.angular_cost)

    @property
    def collapsed(self) -> bool:
        """Whether no speed passed, or hardly any speed is held at any that did."""
        return not self.most_held >= COLLAPSE_SPEED

    @property
    def audit_passed(self) -> bool:
        """Whether a speed passed and the trials at the fastest kept the audit."""
        return self.fastest is not None and self.fastest.audit.passed


class SprintRecord(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One run over a distance.

    Attributes:
        top_speed: v* [m/s].
        distance: [m].
        time: from the first non-zero command to the base's last metre [s]; ``null`` when not reached.
        fell: whether it fell, be it after the line.
        audit: exploit audit of the run.
    """

    top_speed: float
    distance: float
    time: Number
    fell: bool
    audit: AuditRecord


class ClockEntry(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The seeded trials at the fastest raw v* with one clock of the policy.

    Attributes:
        rate: mean rate of the policy [Hz].
        jitter: half-width of the draw of each period, as a share.
        trials: how many ran.
        completed: how many did not fall.
        held_speed: mean over those [m/s].
        stride_frequency: median over those [Hz].
        clock_distance: of the stride from a whole number of policy steps, median, in policy steps.
    """

    rate: float
    jitter: float
    trials: Count
    completed: Count
    held_speed: Number
    stride_frequency: Number
    clock_distance: Number


class ClockRecord(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What other clocks make of a policy.

    Attributes:
        top_speed: v* [m/s].
        entries: the policy's own clock first.
        followed: share of a change of rate that the stride frequency follows.
    """

    top_speed: float
    entries: Annotated[tuple[ClockEntry, ...], Meta(min_length=1)]
    followed: Number

    @property
    def greatest_loss(self) -> float:
        """Share of the held speed that the worst other clock costs; ``nan`` where nobody completes."""
        own, *others = (number(entry.held_speed) for entry in self.entries)
        known = own > 0.0 and others and all(math.isfinite(held) for held in others)
        return 1.0 - min(others) / own if known else math.nan

    @property
    def harmless(self) -> bool:
        """Whether the policy runs with every clock: 9 of 10 complete, at ``HARMLESS_LOSS`` less at most."""
        complete = all(entry.completed >= 0.9 * entry.trials for entry in self.entries)
        return complete and self.greatest_loss <= HARMLESS_LOSS


class EvaluationRecord(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Everything that an evaluation found out about one policy.

    Attributes:
        format_version: of this structure.
        method: training method, from the policy's contract.
        seed: of the training.
        actuator_model: motor model in training.
        training: device, date, steps and command line of the training.
        policy_sha256: of the policy file.
        robot: name of the robot.
        robot_fingerprint: of its description.
        protocol: settings of the search.
        command_line: that made this record.
        date: ISO 8601.
        versions: of the packages that ran it.
        machine: in words.
        raw: search with the command as it is.
        self_paced: search with the command held within 1 m/s of the measured speed.
        sprint: over the distance, raw, at the fastest v*; ``null`` for a policy that collapsed.
        sprint_self_paced: the same, self-paced.
        clock: other clocks of the policy at the fastest raw v*; ``null`` for a policy that collapsed.
    """

    format_version: int = FORMAT_VERSION
    method: MethodName
    seed: Count
    actuator_model: str
    training: dict[str, str]
    policy_sha256: str
    robot: str
    robot_fingerprint: str
    protocol: dict[str, Any]
    command_line: str
    date: str
    versions: dict[str, str]
    machine: str
    raw: SearchRecord
    self_paced: SearchRecord
    sprint: SprintRecord | None
    sprint_self_paced: SprintRecord | None
    clock: ClockRecord | None = None

    def __post_init__(self) -> None:
        if not self.training.get("environment_steps", "0").isdecimal():
            raise ValueError("environment_steps is no whole number")

    @property
    def credible(self) -> bool:
        """Whether the audit passed at the fastest raw speed, or failed in nothing but a harmless clock."""
        fastest = self.raw.fastest
        if fastest is None:
            return False
        failed = [item.name for item in fastest.audit.items if not item.passed]
        return not failed or (failed == [CLOCK_ITEM] and self.clock is not None and self.clock.harmless)


def number(value: Number) -> float:
    """``nan`` for ``None``."""
    return math.nan if value is None else value


def plain(value: float) -> Number:
    """``None`` for what is not finite."""
    return float(value) if math.isfinite(value) else None


def audit_record(report: AuditReport) -> AuditRecord:
    """The audit without its notes."""
    return AuditRecord(
        items=tuple(
            AuditEntry(
                name=item.name,
                value=plain(item.value),
                unit=item.unit,
                threshold=item.threshold,
                passed=item.passed,
            )
            for item in report.items
        )
    )


def speed_record(result: SpeedResult) -> SpeedRecord:
    """The numbers of one v*."""
    done = [trial.metrics for trial in result.completed]

    def mean(name: str) -> Number:
        return plain(result.mean(name))

    def means(name: str) -> Numbers:
        return tuple(plain(value) for value in result.mean(name)) if done else ()

    return SpeedRecord(
        top_speed=result.top_speed,
        trials=len(result.trials),
        falls=result.falls,
        passed=result.passed,
        held_speed=mean("held_speed"),
        peak_speed=mean("peak_speed"),
        angular_cost=mean("angular_cost"),
        lateral_deviation=mean("lateral_deviation"),
        cost_of_transport=mean("cost_of_transport"),
        electrical_power=mean("electrical_power"),
        stride_frequency=mean("stride_frequency"),
        duty_factor=means("duty_factor"),
        envelope_share=means("envelope_share"),
        audit=audit_record(audit_trials(done)),
        estimate=merge_bands(band for metrics in done for band in metrics.estimate),
    )


def sprint_record(result: SprintResult) -> SprintRecord:
    """The numbers of one run over a distance."""
    return SprintRecord(
        top_speed=result.trial.top_speed,
        distance=result.distance,
        time=plain(result.time),
        fell=not result.trial.completed,
        audit=audit_record(result.trial.audit),
    )


def clock_record(check: ClockCheck) -> ClockRecord:
    """The numbers of a policy with several clocks."""
    return ClockRecord(
        top_speed=check.top_speed,
        followed=plain(check.followed),
        entries=tuple(
            ClockEntry(
                rate=item.clock.rate,
                jitter=item.clock.jitter,
                trials=item.trials,
                completed=item.completed,
                held_speed=plain(item.held_speed),
                stride_frequency=plain(item.stride_frequency),
                clock_distance=plain(item.clock_distance),
            )
            for item in check.clocks
        ),
    )


def encode(record: msgspec.Struct) -> Any:
    """A record as JSON-ready values."""
    return msgspec.to_builtins(record)


def decode(data: Any, kind: type[Any]) -> Any:
    """Inverse of ``encode``. Raises ``msgspec.ValidationError`` for anything else."""
    return msgspec.convert(data, kind)


def write_evaluation(path: Path, record: EvaluationRecord) -> None:
    """Write in one step, on one line; raises ``SprintlabError`` where the disk refuses."""
    atomic_write_bytes(path, msgspec.json.encode(record) + b"\n")


Record = TypeVar("Record")


def read_record(path: Path, kind: type[Record]) -> Record:
    """A record from its JSON file.

    Raises:
        SprintlabError: the file is missing, no regular file, too large, another record, or of another format;
            or a number is beyond ``1e12``.
    """
    content = read_bytes(path, RECORD_LIMIT, what="record")
    try:
        _check_numbers(parse_json(content))
        return msgspec.json.decode(content, type=kind)
    except (msgspec.DecodeError, ValueError, RecursionError) as error:
        raise SprintlabError(f"{path} is no record of this version: {error}") from error


def _check_numbers(value: Any) -> None:
    if isinstance(value, int | float) and abs(value) > _LARGEST:
        raise ValueError(f"a number is beyond {_LARGEST:g}")
    for each in value.values() if isinstance(value, dict) else value if isinstance(value, list) else ():
        _check_numbers(each)


def read_evaluation(path: Path) -> EvaluationRecord:
    """Inverse of ``write_evaluation``; errors as in ``read_record``."""
    return read_record(path, EvaluationRecord)
