"""Gaits that follow the policy's clock or do not, and what other clocks cost."""

import pytest

from sprintlab.evaluation.clock import CLOCKS, ClockCheck, clock_trials


@pytest.fixture
def gait(make_trial):
    def build(clock, steps, held=12.0, falls=0):
        values = {"stride_frequency": clock.rate / steps, "held_speed": held}
        trials = [make_trial(completed=index >= falls, **values) for index in range(10)]
        return clock_trials(clock, trials)

    return build


def test_the_check_tells_a_locked_gait_from_one_that_keeps_its_own_time(gait):
    locked = ClockCheck(top_speed=12.0, clocks=tuple(gait(clock, 7.0) for clock in CLOCKS))
    assert all(item.locked for item in locked.clocks) and locked.followed == pytest.approx(1.0)
    free = ClockCheck(
        top_speed=12.0, clocks=tuple(gait(clock, clock.rate / 7.4, clock.rate / 4) for clock in CLOCKS)
    )
    assert not any(item.locked for item in free.clocks) and free.followed == pytest.approx(0.0, abs=1e-9)
    assert free.cost == free.greatest_loss == pytest.approx(0.04)  # 48 Hz
