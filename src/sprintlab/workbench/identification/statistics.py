"""What a linearized fit knows: intervals that hold under uneven noise, and terms that the model lacks."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sprintlab.core.array_types import FloatArray
from sprintlab.workbench.identification.bench import Bench
from sprintlab.workbench.identification.model import Channel, directions

CONFIDENCE = 0.95
LOAD_LOSS = "difference of driving and braking"
"""The torque lacks a loss with the load."""
ZERO = "zero of a sensor"
"""The torque lacks a constant."""
LARGE = 0.3
"""Share of the largest current from which torque over current shows a gear's loss."""
LACKING = 4.0
"""Standard deviations of a term's share in the residuals beyond which the model lacks it."""

_BLIND = 1e-5  # a singular value below this share of the largest sees nothing
_LEAST_LEFT = 0.05  # share of a residual that the fit leaves, at least
_TAKEN = 0.5  # leverage above which a residual no longer shows its own noise
_NEIGHBOURS = 9  # rows whose median error counts as a spread
_MEDIANS = 512
_IMITATED = (
    0.03  # share of a term left once the parameters have taken theirs: less is the noise of the current
)


class Decomposition:
    """Singular values ``(p,)`` of a Jacobian ``(m, p)`` with unit columns, and what follows from them."""

    singular: FloatArray  # (p,) largest first
    basis: FloatArray  # (m, r) orthonormal: what the parameters can do to the residuals
    leverage: FloatArray  # (m,) share of each residual that the fit takes for itself
    gain: FloatArray  # (p, m) change of each parameter with each residual
    blind_directions: list[FloatArray]  # unit vectors ``(p,)`` of parameters that no residual sees

    def __init__(self, jacobian: Any) -> None:
        matrix = np.asarray(jacobian, dtype=float)
        norms = np.linalg.norm(matrix, axis=0)
        lengths = np.where(norms > 0.0, norms, 1.0)
        left, self.singular, right = np.linalg.svd(matrix / lengths, full_matrices=False)
        floored = np.maximum(self.singular, 1e-12 * float(self.singular[0]))
        seen = self.singular >= _BLIND * self.singular[0]
        self.basis = left[:, seen]
        self.leverage = np.sum(self.basis**2, axis=1)
        self.gain = (right.T / floored) @ left.T / lengths[:, None]
        self.blind_directions = list(right[~seen])


def freedom(decomposition: Decomposition, rows: Sequence[int]) -> list[float]:
    """Residuals less parameters of each channel, of which each adds so many ``rows``."""
    taken = decomposition.leverage
    return [float(end - begin - taken[begin:end].sum()) for begin, end in _ranges(rows)]


def half_widths(decomposition: Decomposition, residuals: FloatArray, rows: Sequence[int]) -> FloatArray:
    """Half widths of the 95 % intervals, in units of the fit ``(p,)``.

    Each residual stands for its own variance (HC3: MacKinnon and White, Journal of Econometrics 29, 1985), so
    that sensors whose noise grows with the signal do not narrow the intervals; where the fit took a residual
    for itself, the channel's noise stands in. The quantile of Student's t takes the effective degrees of
    freedom of each parameter (Welch and Satterthwaite), as the noise is known only as well as rows allow. The
    residuals ``(m,)`` are in units of their channel's noise.
    """
    from scipy import special  # pyright: ignore[reportMissingTypeStubs]

    error = np.abs(residuals) / np.maximum(1.0 - decomposition.leverage, _LEAST_LEFT)
    error = np.where(decomposition.leverage > _TAKEN, np.maximum(error, 1.0), error)
    moved = (decomposition.gain * error) ** 2
    shares = np.array([np.sum(moved[:, begin:end], axis=1) for begin, end in _ranges(rows)])
    left = np.maximum(np.array(freedom(decomposition, rows)), 1.0)[:, None]
    variance = shares.sum(axis=0)
    spread = np.sum(shares**2 / left, axis=0)
    effective = np.where(spread > 0.0, variance**2 / np.where(spread > 0.0, spread, 1.0), 1.0)
    quantile: Any = special.stdtrit(effective, 0.5 + CONFIDENCE / 2.0)
    return quantile * np.sqrt(variance)


def local_median(size: FloatArray, error: FloatArray) -> FloatArray:
    """Median error among the quarter of the rows that are nearest in size, nine at least ``(k,)``.

    Sensors are noisier where they read much; one spread for all rows would call their readings outliers.
    Of many rows at most ``_MEDIANS`` medians are worked out, evenly spread: the quarters of neighbouring rows
    are nearly the same, and the time would grow with the square of the rows.
    """
    count = len(size)
    width = min(count, max(_NEIGHBOURS, count // 4))
    order = np.argsort(size, kind="stable")
    starts = np.clip(np.arange(count) - width // 2, 0, count - width)
    step = -(-(count - width + 1) // _MEDIANS)
    windows = np.lib.stride_tricks.sliding_window_view(error[order], width)[::step]
    medians = np.array([np.median(window) for window in windows])
    local = np.empty(count)
    local[order] = medians[starts // step]
    return local


def fault_of_bench(
    bench: Bench,
    torque: Channel,
    kept: NDArray[np.bool_],
    decomposition: Decomposition,
    residuals: FloatArray,
) -> str:
    """``LOAD_LOSS`` or ``ZERO``, if the residuals of the torque still follow it after the fit.

    A score test of one term for each, in which every residual has its own variance. ``kept`` are the rows
    that are no outliers ``(n,)``; the residuals ``(m,)`` are in units of their channel's noise.
    """
    row = torque.rows[kept[torque.rows]]
    way, size = directions(bench)[row], np.abs(bench.current[row])
    drives = (np.sign(bench.current[row]) * way)[size > LARGE * float(np.max(np.abs(bench.current)))]
    terms = {ZERO: np.ones(len(row))}
    if (drives > 0.0).any() and (drives < 0.0).any():
        terms = {LOAD_LOSS: size * way, **terms}
    strongest, found = LACKING, ""
    for name, term in terms.items():
        column = np.zeros(len(residuals))
        column[: len(row)] = term
        left = column - decomposition.basis @ (decomposition.basis.T @ column)
        spread = float(np.linalg.norm(left * residuals))
        if spread == 0.0 or np.linalg.norm(left) < _IMITATED * np.linalg.norm(column):
            continue
        strength = abs(float(left @ residuals)) / spread
        if strength > strongest:
            strongest, found = strength, name
    return found


def _ranges(rows: Sequence[int]) -> list[tuple[int, int]]:
    return list(pairwise(np.cumsum([0, *rows]).tolist()))
