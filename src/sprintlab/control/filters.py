"""First-order low-pass filters, the same in training, evaluation and deployment."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

from sprintlab.control.arrays import Array, where_rows
from sprintlab.core.checks import check_positive
from sprintlab.core.errors import InvalidValueError

PROPRIOCEPTION_CUTOFF_HZ = 10.0
"""Cutoff of the proprioceptive low-pass [Hz] (the paper's)."""

ESTIMATE_CUTOFF_HZ = 3.0
"""Cutoff of the low-pass on an estimator's output [Hz] (the paper's)."""


def low_pass_coefficient(cutoff_hz: float, rate_hz: float) -> float:
    """Weight of the newest sample, ``1 - exp(-2 pi cutoff / rate)``: the exact step response of RC."""
    check_positive("cutoff_hz", cutoff_hz, "Hz")
    check_positive("rate_hz", rate_hz, "Hz")
    return -math.expm1(-2.0 * math.pi * cutoff_hz / rate_hz)


def low_pass(previous: Array, value: Array, coefficient: float) -> Array:
    """One filter step: ``previous + coefficient (value - previous)``; any shape."""
    return previous + coefficient * (value - previous)


@dataclass(frozen=True, kw_only=True)
class LowPass:
    """A low-pass with its rate; the state is the last output and belongs to the caller."""

    cutoff_hz: float = PROPRIOCEPTION_CUTOFF_HZ
    """Frequency at which the continuous filter passes 1/sqrt(2) [Hz]."""
    rate_hz: float = 50.0
    """Rate at which ``step`` is called [Hz]; at least twice the cutoff."""

    def __post_init__(self) -> None:
        low_pass_coefficient(self.cutoff_hz, self.rate_hz)
        if self.cutoff_hz > self.rate_hz / 2:
            raise InvalidValueError(
                "cutoff_hz", self.cutoff_hz, f"at most rate_hz / 2 = {self.rate_hz / 2:g} Hz"
            )

    @cached_property
    def coefficient(self) -> float:
        """Weight of the newest sample."""
        return low_pass_coefficient(self.cutoff_hz, self.rate_hz)

    def step(self, previous: Array, value: Array, reset_mask: Array | None = None) -> Array:
        """Filtered ``value`` ``(n, k)``; rows of ``reset_mask`` ``(n,)`` start from ``value`` itself."""
        filtered = low_pass(previous, value, self.coefficient)
        return filtered if reset_mask is None else where_rows(reset_mask, value, filtered)
