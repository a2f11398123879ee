import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sprintlab.viewer.page import PaceMeter
from sprintlab.viewer.plots import value_range

VALUES = st.lists(st.floats(-200.0, 200.0), min_size=1, max_size=20)


@given(values=VALUES)
def test_the_range_of_a_plot_holds_zero_and_every_value(values):
    low, high = value_range(np.array(values))
    assert low <= min(0.0, *values)
    assert high >= max(1.0, *values)


@given(pace=st.floats(0.01, 2.0))
def test_pace_is_simulated_time_over_the_clock_s(pace):
    meter = PaceMeter()
    shown = [meter.after(pace * 0.033 * step, 0.033 * step) for step in range(100)]
    assert shown[-1] == pytest.approx(pace)
