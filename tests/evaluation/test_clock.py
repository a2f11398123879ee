"""The policy's clock: its ticks, gaits that follow it or not, the check over several clocks."""

import dataclasses
import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.short_trials import COARSE

from sprintlab.api.clock_check import clock_numbers, clock_table, clock_verdict
from sprintlab.core.errors import InvalidValueError
from sprintlab.evaluation.clock import CLOCKS, PolicyClock, followed_share
from sprintlab.evaluation.clock_check import ClockCheck, check_clock, clock_trials
from sprintlab.evaluation.pool import TrialPool
from sprintlab.evaluation.protocol import ProtocolSettings

QUICK = ProtocolSettings(trials=2, required=2, hold=0.5, plant=COARSE)


def ticks(clock, count=5000, seed=0):
    return np.array(list(itertools.islice(clock.periods(1000.0, seed), count)))


def test_the_own_clock_ticks_every_twenty_motor_steps():
    assert set(ticks(PolicyClock())) == {20}


@given(st.floats(20.0, 200.0))
def test_the_mean_rate_is_kept_though_ticks_fall_on_motor_steps(rate):
    periods = ticks(PolicyClock(rate=rate), 2000)
    assert periods.sum() == pytest.approx(2000 * 1000.0 / rate, abs=1.0)
    assert np.ptp(periods) <= 1


def test_jitter_draws_periods_of_the_stated_width_anew_for_every_seed():
    clock = PolicyClock(jitter=0.1)
    periods = ticks(clock)
    assert periods.min() == 18 and periods.max() == 22
    assert periods.mean() == pytest.approx(20.0, abs=0.1)
    assert periods.std() == pytest.approx(2.0 / math.sqrt(3.0), abs=0.25)  # and the rounding to whole steps
    assert (ticks(clock) == periods).all() and (ticks(clock, seed=1) != periods).any()


@pytest.mark.parametrize("bad", [{"rate": 0.0}, {"rate": math.nan}, {"jitter": -0.1}, {"jitter": 0.9}])
def test_a_clock_that_cannot_be_is_refused(bad):
    with pytest.raises(InvalidValueError, match=f"clock.{next(iter(bad))}"):
        PolicyClock(**bad)


def test_a_gait_of_so_many_steps_follows_the_clock_and_one_of_so_much_time_does_not():
    rates = [clock.rate for clock in CLOCKS]
    assert followed_share(CLOCKS, [rate / 7.0 for rate in rates]) == pytest.approx(1.0)
    assert followed_share(CLOCKS, [7.4] * len(rates)) == pytest.approx(0.0)
    assert math.isnan(followed_share(CLOCKS, [7.4, math.nan, math.nan, 7.4]))


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
    assert free.greatest_loss == pytest.approx(0.04)  # 48 Hz


def test_falls_and_undefined_numbers_are_told(gait):
    clocks = [gait(CLOCKS[0], 6.7), gait(CLOCKS[1], 6.7, falls=1), gait(CLOCKS[2], 6.7, falls=10)]
    check = ClockCheck(top_speed=12.0, clocks=tuple(clocks))
    numbers = clock_numbers(check)
    assert [item["completed"] for item in numbers["clocks"]] == [10, 9, 0]
    assert numbers["clocks"][2]["held_speed_m_s"] is None and numbers["greatest_loss_of_speed"] is None
    assert "fell" in clock_verdict(check) and clock_table(check).row_count == 3
    assert check.cost == 1.0


def test_a_clock_costs_the_share_of_the_speed_that_is_lost_with_the_worst_one(gait):
    speeds = zip(CLOCKS, (12.0, 11.88, 12.1, 11.94), strict=True)
    check = ClockCheck(top_speed=12.0, clocks=tuple(gait(clock, 7.0, held) for clock, held in speeds))
    assert check.cost == pytest.approx(0.01)


@pytest.mark.usefixtures("brief_trials")
def test_a_standing_policy_stands_with_every_clock(standing_policy, robot):
    with TrialPool(standing_policy, robot, workers=1) as pool:
        check = check_clock(pool, 0.5, settings=QUICK)
    assert [item.clock for item in check.clocks] == list(CLOCKS)
    assert all(item.completed == item.trials == 2 for item in check.clocks)
    assert abs(check.clocks[0].held_speed) < 0.05 and math.isnan(check.followed)


@pytest.mark.usefixtures("brief_trials")
def test_the_plant_asks_the_policy_when_the_clock_says_so(standing_policy, robot, monkeypatch):
    from sprintlab.control import PolicyRuntime, load_policy
    from sprintlab.evaluation.trial import TrialRequest, run_trial

    asked = []
    step = PolicyRuntime.step
    monkeypatch.setattr(
        PolicyRuntime, "step", lambda self, *inputs: (asked.append(1), step(self, *inputs))[1]
    )
    request = TrialRequest(top_speed=0.5, hold=0.5, plant=QUICK.plant, keep_trajectory=True)
    for rate in (50.0, 25.0):
        asked.clear()
        request = dataclasses.replace(request, clock=PolicyClock(rate=rate))
        end = run_trial(load_policy(standing_policy), robot, request).trajectory.time[-1]
        assert len(asked) == pytest.approx(end * rate, abs=1.5)
