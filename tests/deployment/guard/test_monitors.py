"""Order, age and plausibility of states, persistence, limits of the commanded velocity."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from tests.deployment.messages import make_state

from sprintlab.deployment.guard import Fault, StateMonitor, VelocityLimiter
from sprintlab.robots import load_robot

BP2 = load_robot("bp2")


def standing(sequence, **changes):
    pose = BP2.default_pose + 1e-6 * sequence
    return make_state(sequence, **{"joint_position": pose, **changes})


@given(st.lists(st.integers(1, 40), min_size=1, max_size=60))
def test_whatever_the_order_only_newer_states_are_used(sequences):
    monitor, newest = StateMonitor(BP2), 0
    for step, sequence in enumerate(sequences):
        faults = monitor.accept(standing(sequence), 0.001 * step)
        if sequence > newest:
            assert faults == [Fault.STATE_LOST] * (0 < newest < sequence - 1)
            newest = sequence
        else:
            assert faults == [Fault.STATE_DUPLICATE if sequence == newest else Fault.STATE_OUT_OF_ORDER]
        assert monitor.last is not None and monitor.last.sequence == newest


def test_age_counts_from_the_last_usable_state():
    monitor = StateMonitor(BP2)
    assert not monitor.stale(5.0)
    monitor.accept(standing(1), 1.0)
    monitor.accept(standing(2, bus_voltage=float("nan")), 1.02)
    assert not monitor.stale(1.029) and monitor.stale(1.03)
    monitor.reset()
    assert monitor.accept(standing(1), 2.0) == []


FIELDS = {
    "joint_position": [(low - 0.6, high + 0.6) for low, high in BP2.position_limits],
    "joint_velocity": [(-np.inf, np.inf)] * 12,
    "joint_torque": [(-np.inf, np.inf)] * 12,
    "quaternion": [(0.99, 1.01), *[(-0.14, 0.14)] * 3],
    "angular_velocity": [(-60.0, 60.0)] * 3,
    "bus_voltage": [(0.0, 2.0 * BP2.bus_voltage)],
}
"""What a number of a state may be, the others those of a robot that stands."""


@given(st.sampled_from(list(FIELDS)), st.integers(0, 11), st.floats(), st.booleans())
def test_a_number_that_no_sensor_can_show_is_refused_by_name(field, index, value, first):
    monitor = StateMonitor(BP2)
    still = standing(2)
    if not first:  # a jump from the state before is refused, too
        monitor.accept(standing(1), 0.0)
    values = np.array(getattr(still, field), ndmin=1)
    index %= len(values)
    values[index] = value
    state = standing(2, **{field: values if len(values) > 1 else float(values[0])})
    refused = {Fault.STATE_NOT_FINITE, Fault.STATE_IMPLAUSIBLE} & set(monitor.accept(state, 0.001))
    assert bool(refused) is (monitor.last is not state)
    low, high = FIELDS[field][index]
    if not np.isfinite(value):
        assert refused == {Fault.STATE_NOT_FINITE}
    elif not low <= value <= high:
        assert refused == {Fault.STATE_IMPLAUSIBLE}


def test_a_state_of_another_robot_is_implausible():
    monitor = StateMonitor(load_robot("bp2-waist"))
    for state in (make_state(), make_state(joint_position=np.zeros(13))):
        assert monitor.accept(state, 0.0) == [Fault.STATE_IMPLAUSIBLE]
    assert monitor.last is None


@given(st.lists(st.tuples(*[st.floats(-1e6, 1e6)] * 3), min_size=1, max_size=40))
def test_commanded_velocity_keeps_range_rate_and_friction(wishes):
    limiter, previous = VelocityLimiter(10.0), np.zeros(3)
    for wish in wishes:
        velocity = limiter.advance(np.array(wish), 0.02)
        assert -2.0 <= velocity[0] <= 10.0 and velocity[1] == 0.0 and abs(velocity[2]) <= 1.0
        assert abs(velocity[0] - previous[0]) <= 6.0 * 0.02 + 1e-9
        assert abs(velocity[0] * velocity[2]) <= 0.7 * 9.81 + 1e-6
        previous = velocity


def test_a_brake_takes_the_time_it_should():
    limiter = VelocityLimiter(12.0)
    limiter.velocity = np.array([8.0, 0.0, 0.5])
    steps = 0
    while limiter.velocity[0] > 0.0:
        limiter.brake(0.02)
        steps += 1
    assert steps == 100  # 8 m/s at 4 m/s^2
