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

_STRETCHES = MOST_OF_CURVE // 8  # of a long curve: more than a figure has columns of pixels
_COLUMNS, _ROWS = 600, 450  # cells of a cloud: twice the pixels of an axis
_STACK = 3  # samples that a cell keeps: dots cover several cells, and their colours add up to the full one


def thinned_curve(x: Array, y: Array) -> tuple[Array, Array]:
    """The samples of a curve that show in a picture: of each stretch the first, lowest, highest and last.

    Args:
        x: ``(n,)``, rising.
        y: ``(n,)``.

    Returns:
        Both ``(m,)`` in the same order; unchanged where n is at most ``MOST_OF_CURVE``, else m is at most
        half of that.
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
    """The samples of a cloud of dots that show: a few in each cell of a grid finer than pixels.

    Args:
        x: ``(n,)``, finite.
        y: ``(n,)``, finite.

    Returns:
        Both ``(m,)``, in the same order; unchanged where n is at most ``MOST_OF_CLOUD``. A cell with samples
        keeps its first ones.
    """
    if len(x) <= MOST_OF_CLOUD:
        return x, y
    cell = _places(x, _COLUMNS) * _ROWS + _places(y, _ROWS)
    kept, rest = np.zeros(len(x), dtype=bool), np.arange(len(x))
    first = np.zeros(_COLUMNS * _ROWS, dtype=np.intp)
    for _ in range(_STACK):
        first[cell[rest[::-1]]] = rest[::-1]  # of several values for one place the last one stays
        kept[first[cell[rest]]] = True
        rest = rest[~kept[rest]]
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
