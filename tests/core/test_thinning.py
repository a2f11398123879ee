"""Thinning: what is left out does not show."""

import numpy as np

from sprintlab.core.thinning import MOST_OF_CURVE, thinned_cloud, thinned_curve

RANDOM = np.random.default_rng(3)


def test_a_curve_keeps_ends_and_extremes_of_every_thousandth_of_its_length():
    time, values = np.arange(500_000) * 2e-3, RANDOM.normal(size=500_000)
    values[123_456] = 40.0  # one sample of a kick
    thin, kept = thinned_curve(time, values)
    assert len(thin) <= MOST_OF_CURVE // 2 and (np.diff(thin) > 0.0).all()
    np.testing.assert_array_equal(kept, values[np.searchsorted(time, thin)])
    whole, part = np.arange(500_000) // 500, np.searchsorted(time, thin) // 500
    for operation in (np.maximum, np.minimum):
        begins = [np.flatnonzero(np.diff(group, prepend=-1)) for group in (whole, part)]
        np.testing.assert_array_equal(
            operation.reduceat(kept, begins[1]), operation.reduceat(values, begins[0])
        )
    assert (thin[0], thin[-1]) == (time[0], time[-1])


def test_a_cloud_keeps_a_sample_wherever_there_was_one():
    x, y = RANDOM.normal(size=(2, 400_000))
    x[7], y[7] = 30.0, -30.0  # far from all others
    thin = thinned_cloud(x, y)
    assert len(thin[0]) < 0.7 * len(x) and (30.0, -30.0) in zip(*thin, strict=True)

    def seen(places):
        pixels = (
            np.floor(count * (axis - whole.min()) / np.ptp(whole) * (1.0 - 1e-9)).astype(int)
            for axis, whole, count in zip(places, (x, y), (300, 225), strict=True)
        )
        return {*zip(*pixels, strict=True)}

    assert seen(thin) == seen((x, y))
