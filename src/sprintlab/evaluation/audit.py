"""Looks for the ways in which simulated robots cheat, and says with which limits.

A result that fails is marked, not hidden. The thresholds are this project's own choice; each note says why.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sprintlab.control import POLICY_RATE_HZ
from sprintlab.core.checks import check_positive, check_range
from sprintlab.evaluation.results import AuditItem, AuditReport, TrialMetrics

CLOCK_ITEM = "stride period from policy clock"
"""Name of the item that marks a gait timed by the policy's clock; other clocks tell whether that matters."""


@dataclass(frozen=True, kw_only=True)
class AuditThresholds:
    """Limits of the exploit audit.

    Attributes:
        penetration: deepest that a foot may sink into the ground [m].
        leg_distance: smallest allowed surface distance between legs [m].
        slip_per_step: greatest mean way that a foot slides in one stance [m].
        joint_speed_ratio: highest joint speed over no-load speed.
        clock_distance: smallest distance between the stride period and a whole number of policy steps,
            in policy steps.
        policy_rate: rate of the policy [Hz].

    Raises:
        InvalidValueError: a limit is not positive (the leg distance: negative).
    """

    penetration: float = 0.005
    leg_distance: float = 0.0
    slip_per_step: float = 0.05
    joint_speed_ratio: float = 1.1
    clock_distance: float = 0.02
    policy_rate: float = POLICY_RATE_HZ

    def __post_init__(self) -> None:
        for name in ("penetration", "slip_per_step", "joint_speed_ratio", "clock_distance", "policy_rate"):
            check_positive(f"audit.{name}", getattr(self, name))
        check_range("audit.leg_distance", self.leg_distance, 0.0, 1.0, "m")


def audit_trials(trials: Sequence[TrialMetrics], thresholds: AuditThresholds | None = None) -> AuditReport:
    """Audit one or more trials: worst value of all, for the clock the median.

    A value that is not defined (no step was taken) passes: there is nothing to object to.
    """
    limits = thresholds or AuditThresholds()
    clock = [clock_distance(trial.stride_frequency, limits.policy_rate) for trial in trials]
    return AuditReport(
        items=(
            _at_most(
                "deepest foot penetration",
                _worst([trial.deepest_penetration for trial in trials]),
                limits.penetration,
                "m",
                "deeper contacts store energy that no ground returns",
            ),
            _at_least(
                "smallest leg distance",
                -_worst([-trial.smallest_leg_distance for trial in trials]),
                limits.leg_distance,
                "m",
                "legs must not pass through or lean on each other",
            ),
            _at_most(
                "foot slip per step",
                _worst([trial.slip_per_step for trial in trials]),
                limits.slip_per_step,
                "m",
                "a skating gait depends on the friction model",
            ),
            _at_most(
                "highest joint speed over no-load speed",
                _worst([max(trial.joint_speed_ratio) for trial in trials]),
                limits.joint_speed_ratio,
                "",
                "beyond it a motor cannot drive; impacts may exceed it briefly",
            ),
            _at_least(
                CLOCK_ITEM,
                _median(clock),
                limits.clock_distance,
                "policy steps",
                "a stride of a whole number of policy steps is timed by the clock, not by the robot",
            ),
        )
    )


def clock_distance(stride_frequency: float, policy_rate: float = POLICY_RATE_HZ) -> float:
    """Distance of the stride period from the nearest whole number of policy steps, in policy steps.

    0 to 0.5; 0 means that the gait is locked to an integer divisor of the policy's rate. ``nan`` for a
    frequency that is not defined.
    """
    if not stride_frequency > 0.0:
        return math.nan
    period = policy_rate / stride_frequency
    return abs(period - round(period))


def _at_most(name: str, value: float, threshold: float, unit: str, note: str) -> AuditItem:
    passed = not value > threshold
    return AuditItem(name=name, value=value, unit=unit, threshold=threshold, passed=passed, note=note)


def _at_least(name: str, value: float, threshold: float, unit: str, note: str) -> AuditItem:
    passed = not value < threshold
    return AuditItem(name=name, value=value, unit=unit, threshold=threshold, passed=passed, note=note)


def _worst(values: Sequence[float]) -> float:
    """Largest defined value, ``nan`` when none is."""
    known = [value for value in values if math.isfinite(value)]
    return max(known) if known else math.nan


def _median(values: Sequence[float]) -> float:
    known = [value for value in values if math.isfinite(value)]
    return float(np.median(known)) if known else math.nan
