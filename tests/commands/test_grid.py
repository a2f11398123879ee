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
    TargetSampling,
    UniformSchedule,
    initial_state,
)

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
