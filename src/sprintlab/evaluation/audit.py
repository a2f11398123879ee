"""Looks for the ways in which simulated robots cheat, and says with which limits.

A result that fails is marked, not hidden. Each check states why it is asked and where its limit comes from.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from sprintlab.control import POLICY_RATE_HZ
from sprintlab.evaluation.results import LANE_WIDTH, REST_SPEED, AuditItem, AuditReport, TrialMetrics

CLOCK_ITEM = "stride period from policy clock"
"""Name of the item that marks a gait timed by the policy's clock; other clocks tell whether that matters."""
CLOCK_LOSS_ITEM = "speed lost with another policy clock"
"""Name of the item that takes its place where other clocks were tried."""
CLOCK_DISTANCE = 0.02
"""A stride nearer to a whole number of policy steps is timed by the clock [policy steps]."""
CLOCK_LOSS = 0.02
"""Most that such a gait may lose with another clock, as a share of its speed."""
TOLERANCE = 0.15
"""Share of its limit by which the worst trial may miss it where the median of the trials keeps it: with the
worst of many trials alone, passing at the limit would be chance."""
SLOWEST_RUN = 1.0
"""From this command on every foot must carry its part [m/s]."""

_ROUNDING = 1e-9  # relative: ten samples of 2 ms are 20 ms


@dataclass(frozen=True, kw_only=True)
class Check:
    """One line of the audit."""

    name: str
    unit: str = ""  # the one of value and limit, empty for a ratio
    value: Callable[[TrialMetrics, float], float]  # from a trial and the policy's rate [Hz]: its worst
    limit: float  # for a stance in policy periods
    note: str  # why it is asked
    source: str  # where the limit comes from
    at_least: bool = False  # whether the limit bounds from below
    tolerance: float = TOLERANCE  # by which share of the limit the worst trial may miss it; inf: the median
    # alone counts
    names_foot: bool = False  # whether the foot of the worst trial that stands least is named

    def item(self, trials: Sequence[TrialMetrics], rate: float) -> AuditItem:
        """The median and the worst of the trials against the limit; ``rate`` of the policy [Hz]."""
        values = [(self.value(trial, rate), trial) for trial in trials]
        known = sorted((pair for pair in values if math.isfinite(pair[0])), key=lambda pair: pair[0])
        worst, trial = (known[0 if self.at_least else -1]) if known else (math.nan, None)
        median = float(np.median([value for value, _ in known])) if known else math.nan
        limit = self.limit / rate if self.unit == "s" else self.limit
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
            detail=_lame_foot(trial) if trial is not None and self.names_foot else "",
        )

    def _keeps(self, value: float, limit: float, tolerance: float) -> bool:
        """Whether a value keeps the limit but for a share of it; one that is not defined does."""
        slack = (tolerance + _ROUNDING) * abs(limit)
        return not (value < limit - slack if self.at_least else value > limit + slack)


def _least(trial: TrialMetrics, shares: Sequence[float]) -> float:
    """The least of the feet's shares where the robot is asked to run, else ``nan``."""
    return min(shares, default=math.nan) if trial.asked_speed >= SLOWEST_RUN - _ROUNDING else math.nan


def _lame_foot(trial: TrialMetrics) -> str:
    """Names the foot that stands least."""
    if not trial.feet or not all(map(math.isfinite, trial.duty_factor)):
        return ""
    foot = int(np.argmin(trial.duty_factor))
    return trial.feet[foot] + (" never touches the ground" if trial.duty_factor[foot] == 0.0 else "")


# fmt: off
CHECKS = (
    Check(name="stance", unit="s", limit=1.0, at_least=True,
          value=lambda trial, _: trial.stance_time,
          note="in a median stance shorter than a policy period no action of the policy reaches the "
               "ground",
          source="the policy's own rate"),
    Check(name="touchdowns per stride and foot", unit="", limit=1.2,
          value=lambda trial, _: trial.touchdowns_per_stride,
          note="a foot that lands, bounces and lands again does not carry the robot",
          source="1 in every regular gait; 1.2 lets every fifth stride bounce: this project's choice"),
    Check(name="foot force", unit="body weights", limit=4.0,
          value=lambda trial, _: trial.foot_force,
          note="mean over 5 ms; what hits the ground harder does not last",
          source="strides of the speed limit need 2.4 to 3.0; one third more: this project's choice"),
    Check(name="gear torque", unit="x peak", limit=3.0,
          value=lambda trial, _: max(trial.gear_torque_ratio, default=math.nan),
          note="mean over 1 ms, rotor inertia times acceleration included, over the peak joint torque: a "
               "touchdown turns the rotor through the teeth",
          source="this project's choice; makers of planetary gears bound the emergency-stop torque, which "
                 "may come 1000 times in a gear's life (Beckhoff AG2400, technical terms)"),
    Check(name="joint speed", unit="x no-load", limit=1.1,
          value=lambda trial, _: max(trial.joint_speed_ratio, default=math.nan),
          note="beyond no-load speed a motor cannot drive; impacts may exceed it briefly",
          source="10 % for impacts: this project's choice"),
    Check(name="hottest winding at the line", unit="degC", limit=120.0,
          value=lambda trial, _: trial.line_winding_temperature,
          note="from 25 degC at the start; a run that cooks its motors cannot be repeated",
          source="IEC 60085, thermal class 120 (E)"),
    Check(name="pad deflection", unit="m", limit=0.015,
          value=lambda trial, _: trial.pad_deflection,
          note="deeper contacts store energy that no pad returns",
          source="half the radius of BP2's foot, 30 mm"),
    Check(name="smallest leg distance", unit="m", limit=0.0, at_least=True,
          value=lambda trial, _: trial.smallest_leg_distance,
          note="legs must not pass through or lean on each other",
          source="solid bodies do not overlap"),
    Check(name="foot slip per step", unit="m", limit=0.05,
          value=lambda trial, _: trial.slip_per_step,
          note="a skating gait depends on the friction model",
          source="this project's choice"),
    Check(name="farthest foot from the lane's middle", unit="m", limit=LANE_WIDTH / 2.0,
          value=lambda trial, _: trial.lane_excursion,
          note="over the 100 m, the foot's radius included; who leaves the lane ran another race",
          source="half of the lane's 1.22 m (World Athletics, Technical Rule 14.4)"),
    Check(name="speed when it should stand", unit="m/s", limit=REST_SPEED,
          value=lambda trial, _: trial.final_speed,
          note="in the last second, in which the command has been zero for a second; a runner can stop",
          source="a tenth of a slow trot: this project's choice"),
    Check(name="least load on a foot", unit="", limit=0.10, at_least=True, names_foot=True,
          value=lambda trial, _: _least(trial, trial.load_share),
          note="share of the ground's force, commands from 1 m/s on; a robot that runs on three legs is "
               "lame",
          source="a quarter in a symmetric gait; less than half of that: this project's choice"),
    Check(name="least duty factor of a foot", unit="", limit=0.05, at_least=True, names_foot=True,
          value=lambda trial, _: _least(trial, trial.duty_factor),
          note="commands from 1 m/s on",
          source="strides of the speed limit need 0.12; less than half of that: this project's choice"),
    Check(name="held share of the command", unit="", limit=0.80, at_least=True,
          value=lambda trial, _: trial.command_share,
          note="a robot that stands still breaks no other limit",
          source="this project's choice"),
    Check(name=CLOCK_ITEM, unit="policy steps", limit=CLOCK_DISTANCE, at_least=True, tolerance=math.inf,
          value=lambda trial, rate: clock_distance(trial.stride_frequency, rate),
          note="a stride of a whole number of policy steps is timed by the clock, not by the robot",
          source="seven times what the measure resolves; the median alone counts"),
)
"""In the order of the table."""
# fmt: on


def audit_trials(trials: Sequence[TrialMetrics], policy_rate: float = POLICY_RATE_HZ) -> AuditReport:
    """Audit one or more trials of a policy that acts at ``policy_rate`` [Hz].

    A line passes when the median over the trials of each trial's worst keeps the limit, and no trial misses
    it by more than ``TOLERANCE``. A value that is not defined (no step was taken) passes.
    """
    return AuditReport(items=tuple(check.item(trials, policy_rate) for check in CHECKS))


def with_clock_loss(report: AuditReport, loss: float) -> AuditReport:
    """The audit of a gait that is timed by the policy's clock, once other clocks have told what that costs.

    ``loss`` is the share of the held speed that the worst other clock costs; 1 where a trial failed there.
    """
    item = AuditItem(
        name=CLOCK_LOSS_ITEM,
        value=loss,
        worst=loss,
        unit="",
        threshold=CLOCK_LOSS,
        passed=loss <= CLOCK_LOSS,
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
