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
    value: Callable[[TrialMetrics], float]  # the worst of a trial
    limit: float
    note: str  # why it is asked
    source: str  # where the limit comes from
    at_least: bool = False  # whether the limit bounds from below
    names_foot: bool = False  # whether the foot of the worst trial that stands least is named

    def item(self, trials: Sequence[TrialMetrics]) -> AuditItem:
        """The median and the worst of the trials against the limit."""
        values = [(self.value(trial), trial) for trial in trials]
        known = sorted((pair for pair in values if math.isfinite(pair[0])), key=lambda pair: pair[0])
        worst, trial = (known[0 if self.at_least else -1]) if known else (math.nan, None)
        median = float(np.median([value for value, _ in known])) if known else math.nan
        return AuditItem(
            name=self.name,
            value=median,
            worst=worst,
            unit=self.unit,
            threshold=self.limit,
            passed=self._keeps(median, 0.0) and self._keeps(worst, TOLERANCE),
            note=self.note,
            source=self.source,
            bound="at least" if self.at_least else "at most",
            detail=_lame_foot(trial) if trial is not None and self.names_foot else "",
        )

    def _keeps(self, value: float, tolerance: float) -> bool:
        """Whether a value keeps the limit but for a share of it; one that is not defined does."""
        slack = (tolerance + _ROUNDING) * abs(self.limit)
        return not (value < self.limit - slack if self.at_least else value > self.limit + slack)


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
    Check(name="stance", unit="s", limit=1.0 / POLICY_RATE_HZ, at_least=True,
          value=lambda trial: trial.stance_time,
          note="in a median stance shorter than a policy period no action of the policy reaches the "
               "ground",
          source="the policy's own rate"),
    Check(name="touchdowns per stride and foot", unit="", limit=1.2,
          value=lambda trial: trial.touchdowns_per_stride,
          note="a foot that lands, bounces and lands again does not carry the robot",
          source="1 in every regular gait; 1.2 lets every fifth stride bounce: this project's choice"),
    Check(name="foot force", unit="body weights", limit=4.0,
          value=lambda trial: trial.foot_force,
          note="mean over 5 ms; what hits the ground harder does not last",
          source="strides of the speed limit need 2.4 to 3.0; one third more: this project's choice"),
    Check(name="gear torque", unit="x peak", limit=3.0,
          value=lambda trial: max(trial.gear_torque_ratio, default=math.nan),
          note="mean over 1 ms, rotor inertia times acceleration included, over the peak joint torque: a "
               "touchdown turns the rotor through the teeth",
          source="this project's choice; makers of planetary gears bound the emergency-stop torque, which "
                 "may come 1000 times in a gear's life (Beckhoff AG2400, technical terms)"),
    Check(name="joint speed", unit="x no-load", limit=1.1,
          value=lambda trial: max(trial.joint_speed_ratio, default=math.nan),
          note="beyond no-load speed a motor cannot drive; impacts may exceed it briefly",
          source="10 % for impacts: this project's choice"),
    Check(name="hottest winding at the line", unit="degC", limit=120.0,
          value=lambda trial: trial.line_winding_temperature,
          note="from 25 degC at the start; a run that cooks its motors cannot be repeated",
          source="IEC 60085, thermal class 120 (E)"),
    Check(name="pad deflection", unit="m", limit=0.015,
          value=lambda trial: trial.pad_deflection,
          note="deeper contacts store energy that no pad returns",
          source="half the radius of BP2's foot, 30 mm"),
    Check(name="smallest leg distance", unit="m", limit=0.0, at_least=True,
          value=lambda trial: trial.smallest_leg_distance,
          note="legs must not pass through or lean on each other",
          source="solid bodies do not overlap"),
    Check(name="foot slip per step", unit="m", limit=0.05,
          value=lambda trial: trial.slip_per_step,
          note="a skating gait depends on the friction model",
          source="this project's choice"),
    Check(name="farthest foot from the lane's middle", unit="m", limit=LANE_WIDTH / 2.0,
          value=lambda trial: trial.lane_excursion,
          note="over the 100 m, the foot's radius included; who leaves the lane ran another race",
          source="half of the lane's 1.22 m (World Athletics, Technical Rule 14.4)"),
    Check(name="speed when it should stand", unit="m/s", limit=REST_SPEED,
          value=lambda trial: trial.final_speed,
          note="in the last second, in which the command has been zero for a second; a runner can stop",
          source="a tenth of a slow trot: this project's choice"),
    Check(name="least load on a foot", unit="", limit=0.10, at_least=True, names_foot=True,
          value=lambda trial: _least(trial, trial.load_share),
          note="share of the ground's force, commands from 1 m/s on; a robot that runs on three legs is "
               "lame",
          source="a quarter in a symmetric gait; less than half of that: this project's choice"),
    Check(name="least duty factor of a foot", unit="", limit=0.05, at_least=True, names_foot=True,
          value=lambda trial: _least(trial, trial.duty_factor),
          note="commands from 1 m/s on",
          source="strides of the speed limit need 0.12; less than half of that: this project's choice"),
    Check(name="held share of the command", unit="", limit=0.80, at_least=True,
          value=lambda trial: trial.command_share,
          note="a robot that stands still breaks no other limit",
          source="this project's choice"),
)
"""In the order of the table."""
# fmt: on


def audit_trials(trials: Sequence[TrialMetrics]) -> AuditReport:
    """Audit one or more trials.

    A line passes when the median over the trials of each trial's worst keeps the limit, and no trial misses
    it by more than ``TOLERANCE``. A value that is not defined (no step was taken) passes.
    """
    return AuditReport(items=tuple(check.item(trials) for check in CHECKS))
