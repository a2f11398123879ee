"""Curves without their noise."""

from __future__ import annotations

import numpy as np

from sprintlab.core.array_types import Array


def moving_average(values: Array, time: Array, window: float) -> Array:
    """Centred moving average that keeps the length; the ends average over what is there."""
    width = max(1, min(len(values), round(window / float(time[1] - time[0]))))
    kernel = np.ones(width)
    return np.convolve(values, kernel, "same") / np.convolve(np.ones(len(values)), kernel, "same")
