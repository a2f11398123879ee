"""Methods side by side: mean and spread over seeds, as rows of text for any table."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sprintlab.core.checks import check_choice
from sprintlab.evaluation.results import ProtocolResult

METHOD_COLUMNS = (
    "method",
    "seeds",
    "max velocity",
    "peak 0.5 s",
    "J",
    "J_norm",
    "J at common speed",
    "audit",
)
"""Headings of the rows of ``method_cells``; speeds in m/s, J in rad^2/s,
``J common`` at one v* for all."""


@dataclass(frozen=True, kw_only=True)
class Spread:
    """Mean and sample standard deviation over the seeds that have a value.

    Attributes:
        mean: ``nan`` without a value.
        deviation: ``nan`` with fewer than two values.
    """

    mean: float
    deviation: float

    def text(self, digits: int = 2) -> str:
        """``mean ± deviation``, a dash where it is not defined."""
        if not math.isfinite(self.mean):
            return "-"
        spread = f" ± {self.deviation:.{digits}f}" if math.isfinite(self.deviation) else ""
        return f"{self.mean:.{digits}f}{spread}"


@dataclass(frozen=True, kw_only=True)
class MethodRow:
    """One method's protocol results over its seeds.

    Attributes:
        method: its name.
        seeds: number of training seeds.
        max_velocity: [m/s].
        peak_speed: 0.5 s mean [m/s].
        angular_cost: J at the method's own max velocity [rad^2/s].
        normalized_cost: J over the mean J of the reference method.
        common_cost: J at the common speed [rad^2/s].
        audit_passed: how many seeds passed the audit in every trial of their best speed.
    """

    method: str
    seeds: int
    max_velocity: Spread
    peak_speed: Spread
    angular_cost: Spread
    normalized_cost: Spread
    common_cost: Spread
    audit_passed: int


def spread(values: Sequence[float]) -> Spread:
    """Mean and sample standard deviation of the values that are finite."""
    known = np.array([value for value in values if math.isfinite(value)])
    return Spread(
        mean=float(known.mean()) if known.size else math.nan,
        deviation=float(known.std(ddof=1)) if known.size > 1 else math.nan,
    )


def method_rows(
    results: Mapping[str, Sequence[ProtocolResult]], reference: str = "sprint"
) -> list[MethodRow]:
    """One row a method, in the order given.

    Args:
        results: method name to the results of its seeds, all given the command in the same way.
        reference: the method whose mean J is 1 in ``normalized_cost`` (the paper's Ours).

    Raises:
        InvalidValueError: ``reference`` is not among the methods.
    """
    check_choice("reference", reference, tuple(results))
    unit = spread([result.angular_cost for result in results[reference]]).mean
    return [_row(method, seeds, unit) for method, seeds in results.items()]


def method_cells(row: MethodRow) -> tuple[str, ...]:
    """The row as text under ``METHOD_COLUMNS``."""
    return (
        row.method,
        str(row.seeds),
        row.max_velocity.text(2),
        row.peak_speed.text(2),
        row.angular_cost.text(2),
        row.normalized_cost.text(3),
        row.common_cost.text(2),
        f"{row.audit_passed} of {row.seeds} passed",
    )


def _row(method: str, seeds: Sequence[ProtocolResult], unit: float) -> MethodRow:
    return MethodRow(
        method=method,
        seeds=len(seeds),
        max_velocity=spread([result.max_velocity for result in seeds]),
        peak_speed=spread([result.peak_speed for result in seeds]),
        angular_cost=spread([result.angular_cost for result in seeds]),
        normalized_cost=spread([result.angular_cost / unit if unit else math.nan for result in seeds]),
        common_cost=spread([result.angular_cost_common for result in seeds]),
        audit_passed=sum(_audit_passed(result) for result in seeds),
    )


def _audit_passed(result: ProtocolResult) -> bool:
    """Whether the best speed exists and each of its completed trials passed."""
    return result.best is not None and all(trial.audit.passed for trial in result.best.completed)
