"""Distances between the legs, whose thighs and shanks are capsules."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from sprintlab.core.array_types import FloatArray

_PARALLEL = 1e-12


def segment_distance(
    first_start: FloatArray, first_end: FloatArray, second_start: FloatArray, second_end: FloatArray
) -> FloatArray:
    """Smallest distance [m] between two line segments with ends ``(..., 3)``, which may be points.

    Closest points of two lines, clamped to the segments one after the other (Ericson, Real-Time Collision
    Detection, 5.1.9).
    """
    first, second, offset = first_end - first_start, second_end - second_start, first_start - second_start
    a, e, b = _dot(first, first), _dot(second, second), _dot(first, second)
    c, f = _dot(first, offset), _dot(second, offset)
    s = np.clip(_divide(b * f - c * e, a * e - b * b), 0.0, 1.0)
    t = np.clip(_divide(b * s + f, e), 0.0, 1.0)
    s = np.clip(_divide(b * t - c, a), 0.0, 1.0)
    gap = offset + s[..., None] * first - t[..., None] * second
    return np.sqrt(_dot(gap, gap))


def leg_distance(start: FloatArray, end: FloatArray, radius: FloatArray) -> FloatArray:
    """Smallest surface distance between any two legs ``(T,)`` [m]; negative where they overlap.

    Args:
        start: ``(T, legs, capsules, 3)`` one end of each capsule's axis.
        end: the other end, same shape.
        radius: ``(legs, capsules)``.
    """
    smallest = np.full(len(start), np.inf)
    for one, other in combinations(range(start.shape[1]), 2):
        distance = segment_distance(
            start[:, one, :, None], end[:, one, :, None], start[:, other, None], end[:, other, None]
        )
        surface = distance - radius[one][:, None] - radius[other][None, :]
        smallest = np.minimum(smallest, surface.min(axis=(1, 2)))
    return smallest


def _dot(first: FloatArray, second: FloatArray) -> FloatArray:
    return np.einsum("...i,...i->...", first, second)


def _divide(numerator: FloatArray, denominator: FloatArray) -> FloatArray:
    """Quotient, 0 where the denominator vanishes (parallel segments, or a point)."""
    safe = denominator > _PARALLEL
    return np.where(safe, numerator, 0.0) / np.where(safe, denominator, 1.0)
