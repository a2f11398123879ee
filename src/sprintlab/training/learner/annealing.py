"""What sinks towards the end of a run: action noise, divergence of updates, learning rate of the estimator.

A policy runs without action noise, so the end of a training practises and estimates that. The exported
estimate shall not depend on the last few steps of its optimizer.
"""

from __future__ import annotations

import math

ANNEALED = (0.5, 0.92)
"""Shares of the run between which everything here sinks."""
LEAST_STD, MOST_STD, FINAL_STD = 0.25, 0.42, 0.12
"""Floor and ceiling of the action noise's standard deviation before, and both after. Without the floor the
noise collapses to 0.1 and the gait freezes."""
DESIRED_KL, FINAL_KL = 0.01, 0.002
"""Kullback-Leibler divergence that an update aims at, before and after."""
ESTIMATOR_RATE, FINAL_ESTIMATOR_RATE = 1e-3, 1e-4
"""Learning rate of the estimator's own optimizer, before and after."""


def annealed(share: float) -> float:
    """How far this share of the run lies between the ends of ``ANNEALED``: 0 before them, 1 after."""
    first, last = ANNEALED
    return min(max((share - first) / max(last - first, 1e-9), 0.0), 1.0)


def std_floor(share: float) -> float:
    """Least deviation of the action noise after this share of the run."""
    return LEAST_STD + annealed(share) * (FINAL_STD - LEAST_STD)


def std_ceiling(share: float) -> float:
    """Greatest deviation of the action noise after this share of the run; none before the annealing."""
    sunk = annealed(share)
    return math.inf if sunk == 0.0 else MOST_STD + sunk * (FINAL_STD - MOST_STD)


def divergence_aim(share: float) -> float:
    """Divergence that an update aims at after this share of the run."""
    return DESIRED_KL * (FINAL_KL / DESIRED_KL) ** annealed(share)


def estimator_rate(share: float) -> float:
    """Learning rate of the estimator after this share of the run: a straight line of its logarithm."""
    return ESTIMATOR_RATE * (FINAL_ESTIMATOR_RATE / ESTIMATOR_RATE) ** annealed(share)
