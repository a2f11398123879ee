"""What sinks towards the end of a run: action noise, divergence of updates, learning rate of the estimator.

A policy runs without action noise, so the end of a training practises and estimates that. The exported
estimate shall not depend on the last few steps of its optimizer.
"""

from __future__ import annotations

import math
from typing import NamedTuple

ANNEALED = (0.5, 0.92)
"""Shares of the run between which everything here sinks."""
LEAST_STD, MOST_STD, FINAL_STD = 0.25, 0.42, 0.12
"""Floor and ceiling of the action noise's standard deviation before, and both after. Without the floor the
noise collapses to 0.1 and the gait freezes."""
DESIRED_KL, FINAL_KL = 0.01, 0.002
"""Kullback-Leibler divergence that an update aims at, before and after."""
ESTIMATOR_RATE, FINAL_ESTIMATOR_RATE = 1e-3, 1e-4
"""Learning rate of the estimator's own optimizer, before and after."""


class Annealed(NamedTuple):
    """What holds in a part of the run."""

    least_std: float  # least deviation of the action noise
    most_std: float  # greatest one; none before the annealing
    desired_kl: float  # divergence that an update aims at
    estimator_rate: float


def annealed(share: float) -> Annealed:
    """What holds after this share of the run; rate and divergence sink evenly in their logarithm."""
    first, last = ANNEALED
    sunk = min(max((share - first) / max(last - first, 1e-9), 0.0), 1.0)
    return Annealed(
        least_std=LEAST_STD + sunk * (FINAL_STD - LEAST_STD),
        most_std=math.inf if sunk == 0.0 else MOST_STD + sunk * (FINAL_STD - MOST_STD),
        desired_kl=DESIRED_KL * (FINAL_KL / DESIRED_KL) ** sunk,
        estimator_rate=ESTIMATOR_RATE * (FINAL_ESTIMATOR_RATE / ESTIMATOR_RATE) ** sunk,
    )
