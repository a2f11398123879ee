"""Distances between segments and legs."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from sprintlab.evaluation.geometry import leg_distance, segment_distance

POINTS = arrays(float, (4, 3), elements=st.floats(-1.0, 1.0).map(lambda value: round(value, 3)))


@given(points=POINTS)
def test_equals_a_numerical_minimum(points):
    minimize = pytest.importorskip("scipy.optimize").minimize
    first, first_end, second, second_end = points

    along = np.stack((first_end - first, second - second_end))

    def squared(shares):
        gap = first - second + shares @ along
        return float(gap @ gap), 2.0 * along @ gap

    starts = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0), (0.5, 0.5)]
    best = min(minimize(squared, start, jac=True, bounds=[(0, 1), (0, 1)]).fun for start in starts)
    np.testing.assert_allclose(segment_distance(*points), np.sqrt(best), atol=2e-4)


def test_is_symmetric_and_handles_parallel_segments_and_points():
    start, end = np.array([0.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0])
    above = np.array([0.0, 0.0, 0.3])
    assert segment_distance(start, end, start + above, end + above) == 0.3
    assert segment_distance(start, start, start + above, start + above) == 0.3
    assert segment_distance(start, start, end, end) == 1.0


def test_legs_that_overlap_have_a_negative_distance():
    start = np.array([[[[0.0, 0.0, 0.0]], [[0.1, 0.0, 0.0]], [[0.9, 0.0, 0.0]], [[0.5, 0.0, 0.0]]]])
    end = start + np.array([0.0, 0.0, -0.3])
    radius = np.full((4, 1), 0.06)
    np.testing.assert_allclose(leg_distance(start, end, radius), [0.1 - 0.12])
