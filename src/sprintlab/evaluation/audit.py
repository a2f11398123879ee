"""Looks for the ways in which simulated robots cheat, and says with which limits.

A result that fails is marked, not hidden. Each check states why it is asked and where its limit comes from.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from sprintlab.control import POLICY_RATE_HZ
from sprintlab.core.checks import check_positive, check_range
from sprintlab.evaluation.results import LANE_WIDTH, REST_SPEED, AuditItem, AuditReport, TrialMetrics

CLOCK_ITEM = "stride period from policy clock"
"""Name of the item that marks a gait timed by the policy's clock; other clocks tell whether that matters."""
CLOCK_LOSS_ITEM = "speed lost with another policy clock"
"""Name of the item that takes its place where other clocks were tried."""

TOLERANCE = 0.15
"""Share of its limit by which the worst trial may miss it where the median of the trials keeps it: with the
worst of many trials alone, passing at the limit would be chance."""
SLOWEST_RUN = 1.0
"""From this command on every foot must carry its part [m/s]."""

_ROUNDING = 1e-9  # relative: ten samples of 2 ms are 20 ms

_POSITIVE = (
    "stance_periods",
    "touchdowns_per_stride",
    "foot_force",
    "gear_torque_ratio",
    "joint_speed_ratio",
    "winding_temperature",
    "pad_deflection",
    "slip_per_step",
    "lane_half_width",
    "rest_speed",
    "load_share",
    "duty_factor",
    "command_share",
    "clock_distance",
    "clock_loss",
    "policy_rate",
)


@dataclass(frozen=True, kw_only=True)
class AuditThresholds:
    """Limits of the exploit audit.

    Attributes:
        stance_periods: shortest median stance, in policy periods.
        touchdowns_per_stride: most touchdowns per stride and foot.
        foot_force: greatest force on one foot, mean over 5 ms, in body weights.
        gear_torque_ratio: greatest torque through a gear, mean over 1 ms, over the peak joint torque.
        joint_speed_ratio: highest joint speed over no-load speed.
        winding_temperature: hottest winding at the finish line after a start at 25 degC [degC].
        pad_deflection: deepest that a foot's pad may be pressed in [m].
        leg_distance: smallest allowed surface distance between legs [m].
        slip_per_step: greatest mean distance that a foot slides in one stance [m].
        lane_half_width: farthest that a foot may come from the middle of the lane [m].
        rest_speed: below it a robot counts as at rest [m/s].
        load_share: least share of the ground's force on a foot, from commands of 1 m/s on.
        duty_factor: least share of the time that a foot stands, from commands of 1 m/s on.
        command_share: least held speed over the speed asked for.
        clock_distance: smallest distance between the stride period and a whole number of policy steps,
            in policy steps.
        clock_loss: most that a gait which is timed by the clock may lose with another clock, as a share of
            its speed.
        policy_rate: rate of the policy [Hz].

    Raises:
        InvalidValueError: a limit is not positive (the leg distance: negative).
    """

    stance_periods: float = 1.0
    touchdowns_per_stride: float = 1.2
    foot_force: float = 4.0
    gear_torque_ratio: float = 3.0
    joint_speed_ratio: float = 1.1
    winding_temperature: float = 120.0
    pad_deflection: float = 0.015
    leg_distance: float = 0.0
    slip_per_step: float = 0.05
    lane_half_width: float = LANE_WIDTH / 2.0
    rest_speed: float = REST_SPEED
    load_share: float = 0.10
    duty_factor: float = 0.05
    command_share: float = 0.80
    clock_distance: float = 0.02
    clock_loss: float = 0.02
    policy_rate: float = POLICY_RATE_HZ

    def __post_init__(self) -> None:
        for name in _POSITIVE:
            check_positive(f"audit.{name}", getattr(self, name))
        check_range("audit.leg_distance", self.leg_distance, 0.0, 1.0, "m")


def _no_detail(trial: TrialMetrics) -> str:
    return ""


@dataclass(frozen=True, kw_only=True)
class _Check:
    """One line of the audit.

    Attributes:
        value: of one trial: its worst.
        limit: from the thresholds, in the same unit.
        at_least: whether the limit bounds from below.
        tolerance: by which share of the limit the worst trial may miss it; ``inf``: the median alone counts.
        note: why it is asked.
        source: where the limit comes from.
        detail: what the worst trial did, in words.
    """

    name: str
    unit: str
    value: Callable[[TrialMetrics, AuditThresholds], float]
    limit: Callable[[AuditThresholds], float]
    note: str
    source: str
    at_least: bool = False
    tolerance: float = TOLERANCE
    detail: Callable[[TrialMetrics], str] = _no_detail

    def item(self, trials: Sequence[TrialMetrics], limits: AuditThresholds) -> AuditItem:
        values = [(self.value(trial, limits), trial) for trial in trials]
        known = sorted((pair for pair in values if math.isfinite(pair[0])), key=lambda pair: pair[0])
        worst, trial = (known[0 if self.at_least else -1]) if known else (math.nan, None)
        median = float(np.median([value for value, _ in known])) if known else math.nan
        limit = self.limit(limits)
        return AuditItem(
            name=self.name,
            value=median,
            worst=worst,
            unit=self.unit,
            threshold=limit,
            passed=self._keeps(median, limit, 0.0) and self._keeps(worst, limit, self.tolerance),
            note=self.note,
            source=self.source,
            bound="at least" if self.at_least else "at most",
            detail="" if trial is None else self.detail(trial),
        )

    def _keeps(self, value: float, limit: float, tolerance: float) -> bool:
        """Whether a value keeps the limit but for a share of it; one that is not defined does."""
        slack = (tolerance + _ROUNDING) * abs(limit)
        return not (value < limit - slack if self.at_least else value > limit + slack)


def _from_one_metre_a_second(trial: TrialMetrics, shares: Sequence[float]) -> float:
    """The least of the feet's shares where the robot is asked to run, else ``nan``."""
    return min(shares, default=math.nan) if trial.asked_speed >= SLOWEST_RUN - _ROUNDING else math.nan


def _lame_foot(trial: TrialMetrics) -> str:
    """Names the foot that stands least."""
    if not trial.feet or not all(math.isfinite(share) for share in trial.duty_factor):
        return ""
    foot = int(np.argmin(trial.duty_factor))
    return trial.feet[foot] + (" never touches the ground" if trial.duty_factor[foot] == 0.0 else "")


_CHECKS = (
    _Check(
        name="stance",
        unit="s",
        value=lambda trial, _: trial.stance_time,
        limit=lambda limits: limits.stance_periods / limits.policy_rate,
        at_least=True,
        note="in a median stance shorter than a policy period no action of the policy reaches the ground",
        source="the policy's own rate",
    ),
    _Check(
        name="touchdowns per stride and foot",
        unit="",
        value=lambda trial, _: trial.touchdowns_per_stride,
        limit=lambda limits: limits.touchdowns_per_stride,
        note="a foot that lands, bounces and lands again does not carry the robot",
        source="1 in every regular gait; 1.2 lets every fifth stride bounce: this project's choice",
    ),
    _Check(
        name="foot force",
        unit="body weights",
        value=lambda trial, _: trial.foot_force,
        limit=lambda limits: limits.foot_force,
        note="mean over 5 ms; what hits the ground harder does not last",
        source="strides of the speed limit need 2.4 to 3.0; one third more: this project's choice",
    ),
    _Check(
        name="gear torque",
        unit="x peak",
        value=lambda trial, _: max(trial.gear_torque_ratio),
        limit=lambda limits: limits.gear_torque_ratio,
        note="mean over 1 ms, rotor inertia times acceleration included, over the peak joint torque: "
        "a touchdown turns the rotor through the teeth",
        source="this project's choice; makers of planetary gears bound the emergency-stop torque, which "
        "may come 1000 times in a gear's life (Beckhoff AG2400, technical terms)",
    ),
    _Check(
        name="joint speed",
        unit="x no-load",
        value=lambda trial, _: max(trial.joint_speed_ratio),
        limit=lambda limits: limits.joint_speed_ratio,
        note="beyond no-load speed a motor cannot drive; impacts may exceed it briefly",
        source="10 % for impacts: this project's choice",
    ),
    _Check(
        name="hottest winding at the line",
        unit="degC",
        value=lambda trial, _: trial.line_winding_temperature,
        limit=lambda limits: limits.winding_temperature,
        note="from 25 degC at the start; a run that cooks its motors cannot be repeated",
        source="IEC 60085, thermal class 120 (E)",
    ),
    _Check(
        name="pad deflection",
        unit="m",
        value=lambda trial, _: trial.pad_deflection,
        limit=lambda limits: limits.pad_deflection,
        note="deeper contacts store energy that no pad returns",
        source="half the radius of BP2's foot, 30 mm",
    ),
    _Check(
        name="smallest leg distance",
        unit="m",
        value=lambda trial, _: trial.smallest_leg_distance,
        limit=lambda limits: limits.leg_distance,
        at_least=True,
        note="legs must not pass through or lean on each other",
        source="solid bodies do not overlap",
    ),
    _Check(
        name="foot slip per step",
        unit="m",
        value=lambda trial, _: trial.slip_per_step,
        limit=lambda limits: limits.slip_per_step,
        note="a skating gait depends on the friction model",
        source="this project's choice",
    ),
    _Check(
        name="farthest foot from the lane's middle",
        unit="m",
        value=lambda trial, _: trial.lane_excursion,
        limit=lambda limits: limits.lane_half_width,
        note="over the 100 m, the foot's radius included; who leaves the lane ran another race",
        source="half of the lane's 1.22 m (World Athletics, Technical Rule 14.4)",
    ),
    _Check(
        name="speed when it should stand",
        unit="m/s",
        value=lambda trial, _: trial.final_speed,
        limit=lambda limits: limits.rest_speed,
        note="in the last second, in which the command has been zero for a second; a runner can stop",
        source="a tenth of a slow trot: this project's choice",
    ),
    _Check(
        name="least load on a foot",
        unit="",
        value=lambda trial, _: _from_one_metre_a_second(trial, trial.load_share),
        limit=lambda limits: limits.load_share,
        at_least=True,
        detail=_lame_foot,
        note="share of the ground's force, commands from 1 m/s on; a robot that runs on three legs is lame",
        source="a quarter in a symmetric gait; less than half of that: this project's choice",
    ),
    _Check(
        name="least duty factor of a foot",
        unit="",
        value=lambda trial, _: _from_one_metre_a_second(trial, trial.duty_factor),
        limit=lambda limits: limits.duty_factor,
        at_least=True,
        detail=_lame_foot,
        note="commands from 1 m/s on",
        source="strides of the speed limit need 0.12; less than half of that: this project's choice",
    ),
    _Check(
        name="held share of the command",
        unit="",
        value=lambda trial, _: trial.command_share,
        limit=lambda limits: limits.command_share,
        at_least=True,
        note="a robot that stands still breaks no other limit",
        source="this project's choice",
    ),
    _Check(
        name=CLOCK_ITEM,
        unit="policy steps",
        value=lambda trial, limits: clock_distance(trial.stride_frequency, limits.policy_rate),
        limit=lambda limits: limits.clock_distance,
        at_least=True,
        tolerance=math.inf,
        note="a stride of a whole number of policy steps is timed by the clock, not by the robot",
        source="seven times what the measure resolves; the median alone counts",
    ),
)
"""In the order of the table."""


def audit_trials(trials: Sequence[TrialMetrics], thresholds: AuditThresholds | None = None) -> AuditReport:
    """Audit one or more trials.

    A line passes when the median over the trials of each trial's worst keeps the limit, and no trial misses
    it by more than ``TOLERANCE``. A value that is not defined (no step was taken) passes.
    """
    limits = thresholds or AuditThresholds()
    return AuditReport(items=tuple(check.item(trials, limits) for check in _CHECKS))


def with_clock_loss(
    report: AuditReport, loss: float, thresholds: AuditThresholds | None = None
) -> AuditReport:
    """The audit of a gait that is timed by the policy's clock, once other clocks have told what that costs.

    Args:
        report: with the line on the stride's period.
        loss: of the held speed with the worst other clock, as a share; 1 where a trial failed there.
        thresholds: the limits; the defaults when left out.
    """
    limit = (thresholds or AuditThresholds()).clock_loss
    item = AuditItem(
        name=CLOCK_LOSS_ITEM,
        value=loss,
        worst=loss,
        unit="",
        threshold=limit,
        passed=loss <= limit,
        note="the stride is timed by the policy's clock: the same trials at 48 Hz, at 52 Hz and with periods "
        "that vary by 10 %",
        source="this project's choice",
    )
    return AuditReport(items=tuple(item if old.name == CLOCK_ITEM else old for old in report.items))


def clock_distance(stride_frequency: float, policy_rate: float = POLICY_RATE_HZ) -> float:
    """Distance of the stride period from the nearest whole number of policy steps, in policy steps.

    0 to 0.5; 0 means that the gait is locked to an integer divisor of the policy's rate. ``nan`` for a
    frequency that is not defined.
    """
    if not stride_frequency > 0.0:
        return math.nan
    period = policy_rate / stride_frequency
    return abs(period - round(period))
