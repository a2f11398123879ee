"""A trial on a battery with warm windings: what is recorded, and what follows from it."""

from dataclasses import replace

import pytest
from tests.short_trials import COARSE

from sprintlab.control import load_policy
from sprintlab.evaluation.trial import TrialRequest, run_trial
from sprintlab.motors import (
    Battery,
    I2tLimit,
    WindingHeat,
    open_circuit_voltage,
)


@pytest.fixture(scope="module")
def supplied(standing_policy, robot):
    charged = {"battery": Battery(), "state_of_charge": 0.6}
    limit = I2tLimit(continuous_current=50.0, time_constant=10.0)
    plant = replace(COARSE, **charged, heat=WindingHeat(), winding_temperature=90.0, i2t=limit)
    request = TrialRequest(top_speed=0.5, hold=0.5, plant=plant, keep_trajectory=True)
    return run_trial(load_policy(standing_policy), robot, request)


def test_voltage_loss_temperature_and_i2t_are_recorded(supplied):
    trajectory = supplied.trajectory
    count = len(trajectory.time)
    assert trajectory.bus_voltage.shape == (count,)
    assert trajectory.copper_loss.shape == trajectory.winding_temperature.shape == (count, 12)
    assert {"bus_voltage", "copper_loss", "winding_temperature"} <= set(trajectory.arrays())
    assert supplied.metrics.lowest_bus_voltage == trajectory.bus_voltage.min()
    assert supplied.metrics.hottest_winding == trajectory.winding_temperature.max()
    assert trajectory.i2t_level.shape == (count, 12)
    assert 0.0 < supplied.metrics.highest_i2t_level == trajectory.i2t_level.max() <= 1.0
    source = float(open_circuit_voltage(Battery(), 0.6))
    assert 0.9 * source < supplied.metrics.lowest_bus_voltage < source
    assert 80.0 < trajectory.winding_temperature.min() < supplied.metrics.hottest_winding < 95.0
