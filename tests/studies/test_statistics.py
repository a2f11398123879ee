"""The few-seed statistics against their definitions."""

import math

import numpy as np
import pytest
from studies.paper.statistics import improvement, interquartile_mean


def test_the_middle_half_counts():
    assert interquartile_mean([0.0, 9.0, 10.0, 11.0, 100.0]).center == pytest.approx(10.0)
    assert interquartile_mean([1.0, 2.0, 6.0]).center == pytest.approx(3.0)
    assert interquartile_mean([1.0, math.nan]).center == 1.0


def test_the_interval_covers_the_mean_as_often_as_it_says():
    """With 5 normal seeds the percentile bootstrap covers less than 95 %, but far more than half."""
    random = np.random.default_rng(1)
    found = [interquartile_mean(random.normal(10.0, 1.0, 5).tolist()) for _ in range(60)]
    covered = sum(one.low <= 10.0 <= one.high for one in found)
    assert all(one.low <= one.center <= one.high for one in found) and covered >= 40


def test_improvement_is_the_share_of_pairs():
    ours, theirs = [3.0, 4.0, 5.0], [1.0, 4.0]
    pairs = [1.0 if a > b else 0.5 if a == b else 0.0 for a in ours for b in theirs]
    assert improvement(ours, theirs).center == pytest.approx(np.mean(pairs))
    assert improvement([2.0, 3.0], [0.0, math.nan]).center == 1.0  # a collapse counts as 0 m/s
    assert math.isnan(improvement([], theirs).center)


def test_the_same_seeds_give_the_same_interval():
    assert interquartile_mean([1.0, 2.0, 4.0, 7.0]) == interquartile_mean([1.0, 2.0, 4.0, 7.0])
