"""Order and age of states, persistence, sources, limits of the commanded velocity."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sprintlab.core.errors import InvalidValueError
from sprintlab.deployment.interface import OperatorCommand, Request, RobotState
from sprintlab.deployment.safety import (
    RESPONSES,
    Fault,
    Reaction,
    SafetySettings,
    SourceMonitor,
    StateMonitor,
    VelocityLimiter,
    VelocityLimits,
)
from sprintlab.deployment.safety.timer import Persistence
from sprintlab.robots import load_robot

BP2 = load_robot("bp2")


def numbered(sequence: int) -> RobotState:
    return RobotState(
        sequence=sequence,
        timestamp=sequence * 1_000_000,
        joint_position=np.asarray(BP2.default_pose) + 1e-6 * sequence,
        joint_velocity=np.zeros(12),
        joint_torque=np.zeros(12),
        quaternion=np.array([1.0, 0.0, 0.0, 0.0]),
        angular_velocity=np.zeros(3),
        bus_voltage=60.0,
    )


@given(st.lists(st.integers(1, 40), min_size=1, max_size=60))
def test_whatever_the_order_only_newer_states_are_used(sequences):
    monitor, used = StateMonitor(BP2, SafetySettings()), []
    for step, sequence in enumerate(sequences):
        faults = monitor.accept(numbered(sequence), 0.001 * step)
        newest = max(used, default=0)
        if sequence > newest:
            used.append(sequence)
            assert (Fault.STATE_LOST in faults) == (newest > 0 and sequence > newest + 1)
        else:
            expected = Fault.STATE_DUPLICATE if sequence == newest else Fault.STATE_OUT_OF_ORDER
            assert faults == [expected]
        assert monitor.last is not None and monitor.last.sequence == used[-1]
    assert used == sorted(set(used))


def test_age_counts_from_the_last_usable_state():
    monitor = StateMonitor(BP2, SafetySettings(state_timeout=0.03))
    assert monitor.age(5.0) is None and not monitor.stale(5.0)
    monitor.accept(numbered(1), 1.0)
    monitor.accept(msgspec.structs.replace(numbered(2), bus_voltage=float("nan")), 1.02)
    assert not monitor.stale(1.029) and monitor.stale(1.03)
    monitor.reset()
    assert monitor.accept(numbered(1), 2.0) == []


def test_persistence_needs_an_unbroken_condition():
    timer = Persistence(0.003)
    seen = [timer.update(condition, 0.001 * k) for k, condition in enumerate([1, 1, 0, 1, 1, 1, 1, 1])]
    assert seen == [False, False, False, False, False, False, True, True]


def say(sequence: int, *velocity: float, request: Request = Request.NONE) -> OperatorCommand:
    return OperatorCommand(sequence=sequence, timestamp=0, velocity=np.array(velocity), request=request)


def test_a_source_is_lost_when_it_says_nothing_new():
    monitor = SourceMonitor(0.2)
    assert monitor.lost(0.0)
    assert monitor.accept(say(1, 3.0, 0.0, 0.0, request=Request.RUN), 1.0) == (Request.RUN, [])
    monitor.accept(say(1, 9.0, 0.0, 0.0), 1.1)
    monitor.accept(None, 1.15)
    assert not monitor.lost(1.199) and monitor.lost(1.2)
    assert monitor.velocity[0] == 3.0
    assert monitor.accept(say(0, 1.0, 0.0, 0.0), 1.3) == (Request.NONE, [Fault.SOURCE_INVALID])


@given(st.lists(st.tuples(*[st.floats(-1e6, 1e6)] * 3), min_size=1, max_size=40))
def test_commanded_velocity_keeps_range_rate_and_friction(wishes):
    limits = VelocityLimits(forward=10.0, sideways=0.5)
    limiter, previous = VelocityLimiter(limits), np.zeros(3)
    for wish in wishes:
        velocity = limiter.advance(np.array(wish), 0.02)
        assert -2.0 <= velocity[0] <= 10.0 and abs(velocity[1]) <= 0.5 and abs(velocity[2]) <= 1.0
        assert abs(velocity[0] - previous[0]) <= 6.0 * 0.02 + 1e-9
        assert abs(velocity[0] * velocity[2]) <= limits.friction * 9.81 + 1e-6
        previous = velocity


def test_a_brake_takes_the_time_it_should():
    limiter = VelocityLimiter(VelocityLimits())
    limiter.velocity = np.array([8.0, 0.0, 0.5])
    steps = 0
    while limiter.velocity[0] > 0.0:
        limiter.brake(0.02)
        steps += 1
    assert steps == 100  # 8 m/s at 4 m/s^2


def test_every_fault_has_a_response():
    assert set(RESPONSES) == set(Fault)
    assert all(response.within > 0.0 and response.meaning for response in RESPONSES.values())
    assert {response.reaction for response in RESPONSES.values()} == set(Reaction)


def test_impossible_settings_are_refused():
    with pytest.raises(InvalidValueError, match=r"safety\.state_timeout"):
        SafetySettings(state_timeout=0.0)
    with pytest.raises(InvalidValueError, match=r"velocity_limits\.forward"):
        VelocityLimits(forward=-1.0)
    with pytest.raises(InvalidValueError, match=r"velocity_limits\.braking"):
        VelocityLimits(braking=0.0)


ONE = np.eye(12)[4]


@pytest.mark.parametrize("first", [True, False])
@pytest.mark.parametrize(
    "changes",
    [
        {"joint_position": BP2.position_limits[:, 0] - 0.61 * ONE},
        {"joint_position": BP2.position_limits[:, 1] + 0.61 * ONE},
        {"joint_velocity": 1e3 * ONE},
        {"joint_velocity": -1e3 * ONE},
        {"angular_velocity": np.array([0.0, -61.0, 0.0])},
        {"quaternion": np.array([1.02, 0.0, 0.0, 0.0])},
        {"quaternion": np.array([0.0, 0.98, 0.0, 0.0])},
        {"bus_voltage": -0.1},
        {"bus_voltage": 2.01 * BP2.bus_voltage},
    ],
    ids=lambda changes: "-".join(changes),
)
def test_what_nothing_can_show_is_dropped_also_in_the_first_state(changes, first):
    """Of which no jump tells."""
    monitor = StateMonitor(BP2, SafetySettings())
    if not first:
        monitor.accept(numbered(1), 0.0)
    state = msgspec.structs.replace(numbered(2), **changes)
    assert monitor.accept(state, 0.001) == [Fault.STATE_IMPLAUSIBLE] and monitor.last is not state
