"""The grid curriculum: what is open is drawn, what is held opens its neighbours."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sprintlab.commands import (
    AdaptiveSchedule,
    CommandGrid,
    CommandStep,
    GridBins,
    TargetSampling,
    UniformSchedule,
    initial_state,
)
from sprintlab.core.errors import InvalidValueError

GRID = CommandGrid()
LIKE = np.zeros(1)


def draw(weights: np.ndarray, n: int = 4000, lower: float = -2.0, upper: float = 14.0):
    return GRID.draw(weights, np.random.default_rng(0).random((n, 3)), lower, upper)


def test_at_the_start_only_slow_targets_of_the_range_are_drawn() -> None:
    speed, yaw_rate = draw(GRID.initial_weights(LIKE), lower=-0.5)
    assert speed.min() == pytest.approx(-0.5, abs=0.01) and speed.max() == pytest.approx(1.0, abs=0.01)
    assert np.abs(yaw_rate).max() <= GRID.yaw_limit
    assert len(np.unique(np.floor((yaw_rate + 1) / GRID.yaw_bin))) == GRID.yaw_bins


def test_bins_are_drawn_in_proportion_to_their_weights() -> None:
    weights = np.zeros((GRID.rows, GRID.yaw_bins))
    weights[10, 2], weights[20, 4] = 0.25, 0.75
    speed, yaw_rate = draw(weights, 20000)
    bins = GRID.bins(speed, yaw_rate)
    fast = bins.row == 20
    assert fast.mean() == pytest.approx(0.75, abs=0.02)
    assert set(zip(bins.row.tolist(), bins.column.tolist(), strict=True)) == {(10, 2), (20, 4)}


def test_a_success_opens_its_bin_and_the_eight_around_it_however_many_succeed() -> None:
    weights = np.zeros((GRID.rows, GRID.yaw_bins))
    bins = GridBins(np.array([5, 5, 9]), np.array([2, 2, 0]))
    learned = GRID.learn(weights, bins, np.array([True, True, False]))
    expected = np.zeros_like(weights)
    expected[4:7, 1:4] = GRID.gain
    expected[5, 2] = 2 * GRID.gain
    np.testing.assert_allclose(learned, expected)
    for _ in range(10):
        learned = GRID.learn(learned, bins, np.array([True, True, True]))
    assert learned.max() == 1.0
    assert learned[8:11, 0:2].min() == 1.0


@given(speed=st.floats(-2.0, 13.999), yaw_rate=st.floats(-1.0, 0.999))
def test_a_target_lies_in_its_bin(speed: float, yaw_rate: float) -> None:
    bins = GRID.bins(np.array([speed]), np.array([yaw_rate]))
    low = GRID.speed[0] + bins.row[0] * GRID.speed_bin
    left = -GRID.yaw_limit + bins.column[0] * GRID.yaw_bin
    assert low - 1e-9 <= speed <= low + GRID.speed_bin + 1e-9
    assert left - 1e-9 <= yaw_rate <= left + GRID.yaw_bin + 1e-9


def test_held_means_both_kernels_above_their_thresholds() -> None:
    errors = np.array([0.0, 0.46, 0.48, 0.0, 0.0])
    turns = np.array([0.0, 0.0, 0.0, 0.82, 0.85])
    assert GRID.held(errors, turns).tolist() == [True, True, False, True, False]


def test_schedules_draw_from_the_grid_except_the_uniform_one() -> None:
    weights = np.zeros((GRID.rows, GRID.yaw_bins))
    weights[6, 0] = 1.0  # 1.0 to 1.5 m/s, turning right
    n = 3000
    arguments = {
        "speed": np.zeros(n), "dt": 0.02, "lower": -2.0, "upper": 14.0, "friction": 1.0,
        "reset_mask": np.ones(n, dtype=bool), "random": np.random.default_rng(1).random((n, 8)),
        "weights": weights,
    }  # fmt: skip
    share = 1.0 - TargetSampling().top_share - TargetSampling().zero_share
    in_bin = {}
    for schedule in (AdaptiveSchedule(), UniformSchedule()):
        state = schedule.advance(initial_state(n, LIKE), CommandStep(**arguments))
        bins = GRID.bins(state.target_speed, state.target_yaw_rate)
        in_bin[type(schedule)] = ((bins.row == 6) & (bins.column == 0)).mean()
    assert in_bin[AdaptiveSchedule] == pytest.approx(share, abs=0.03)
    assert in_bin[UniformSchedule] < 0.05


def test_impossible_grids_are_refused() -> None:
    for field, value in {
        "speed": (3.0, 2.0),
        "speed_bin": 2e-6,  # eight million rows take all memory
        "yaw_bins": 0,
        "gain": 1.5,
        "linear_success": -0.1,
    }.items():
        with pytest.raises(InvalidValueError, match=field):
            CommandGrid(**{field: value})
