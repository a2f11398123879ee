"""Less to draw of long records, with nothing lost that a picture can show, and curves without their noise.

Short records stay as they are: the pictures of a race do not change.
"""

from __future__ import annotations

import numpy as np

from sprintlab.core.array_types import Array

MOST_OF_CURVE = 16_000
"""Curves of at most so many samples are drawn whole; of longer ones half as many are left."""
MOST_OF_CLOUD = 20_000
"""Clouds of at most so many samples are drawn whole."""

_STRETCHES = MOST_OF_CURVE // 8  # parts of a long curve: more than a figure has columns of pixels
_COLUMNS, _ROWS = 1200, 900  # cells of a cloud: dots cover several, and their colours add up to the full one


def thinned_curve(x: Array, y: Array) -> tuple[Array, Array]:
    """What shows of a curve ``(n,)`` over rising x: of each stretch first, lowest, highest and last sample.

    Unchanged where n is at most ``MOST_OF_CURVE``, else at most half of that.
    """
    if len(y) <= MOST_OF_CURVE:
        return x, y
    edges = np.linspace(0, len(y), _STRETCHES + 1).astype(np.intp)
    bounds = list(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True))
    extremes = [
        place
        for begin, end in bounds
        for place in (begin + int(y[begin:end].argmin()), begin + int(y[begin:end].argmax()))
    ]
    kept = np.unique(np.concatenate((edges[:-1], edges[1:] - 1, extremes)))
    return x[kept], y[kept]


def thinned_cloud(x: Array, y: Array) -> tuple[Array, Array]:
    """What shows of a cloud of dots, finite ``(n,)``: the first in each cell of a grid finer than pixels.

    Unchanged where n is at most ``MOST_OF_CLOUD``.
    """
    if len(x) <= MOST_OF_CLOUD:
        return x, y
    kept = np.unique(_places(x, _COLUMNS) * _ROWS + _places(y, _ROWS), return_index=True)[1]
    return x[kept], y[kept]


def _places(values: Array, count: int) -> Array:
    """In which of so many equal parts of their range values are."""
    low, high = values.min(), values.max()
    return np.minimum((values - low) * (count / max(high - low, 1e-12)), count - 1).astype(np.intp)


def moving_average(values: Array, time: Array, window: float) -> Array:
    """Centred moving average that keeps the length; the ends average over what is there."""
    width = max(1, min(len(values), round(window / float(time[1] - time[0]))))
    kernel = np.ones(width)
    return np.convolve(values, kernel, "same") / np.convolve(np.ones(len(values)), kernel, "same")
