import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sprintlab.commands import RangeGrowth, StageBlend, ranked_speeds


def test_range_grows_while_the_fastest_twentieth_keep_up():
    growth = RangeGrowth()
    growth.update(0.7, top=6.0)
    assert growth.upper == 1.0
    growth.update(0.71, top=6.0)
    assert growth.upper == pytest.approx(1.1)


def test_range_stops_at_the_stage_top_and_never_shrinks():
    growth = RangeGrowth()
    for _ in range(100):
        growth.update(20.0, top=6.0)
    assert growth.upper == 6.0
    growth.update(20.0, top=3.0)
    assert growth.upper == 6.0
    growth.update(float("nan"), top=12.0)
    assert growth.upper == 6.0


@given(st.floats(0.1, 30.0))
def test_lower_end_follows_the_upper(upper):
    lower = RangeGrowth(upper=upper).lower
    assert lower == max(-2.0, -max(1.0, upper / 3))
    assert -2.0 <= lower <= -1.0


@pytest.mark.parametrize("count", [2, 3, 16, 8192])
def test_ranked_speeds_are_quantiles(torch, count):
    speed = np.random.default_rng(count).normal(size=count).astype(np.float32)
    shares = (0.5, 0.95, 0.999, 1.0)
    quantiles = [np.quantile(speed, share, method="inverted_cdf") for share in shares]
    assert ranked_speeds(speed, shares) == quantiles
    assert [float(value) for value in ranked_speeds(torch.from_numpy(speed), shares)] == quantiles


def test_blend_waits_for_the_top_and_for_the_earliest_iteration():
    blend = StageBlend(first_top=6.0, earliest_iteration=10, ramp_iterations=4)
    for _ in range(20):
        blend.update(5.9)
    assert (blend.weight, blend.top) == (0.0, 6.0)
    blend.update(6.0)
    assert (blend.weight, blend.top) == (0.25, 12.0)
    early = StageBlend(earliest_iteration=10)
    for _ in range(10):
        early.update(6.0)
    assert early.weight == 0.0
    weights = []
    for upper in (6.0, *[1.0] * 200):
        early.update(upper)
        weights.append(early.weight)
    assert weights == pytest.approx([min(1.0, k / 150) for k in range(1, 202)])  # and never goes back


def test_grown_floats_reach_the_top_of_the_stage_for_the_blend():
    growth, blend = RangeGrowth(), StageBlend(earliest_iteration=0, ramp_iterations=10)
    for _ in range(200):
        growth.update(99.0, top=blend.top)
        blend.update(growth.upper)
    assert (growth.upper, blend.weight) == (12.0, 1.0)
