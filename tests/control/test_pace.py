"""The forward command runs ahead, and falls, no more than the policy's contract allows."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from sprintlab.control import Measurement, PolicyRuntime
from sprintlab.control.pace import PaceContract, limit_braking, limit_lead
from sprintlab.core.errors import InvalidValueError

LIMITS = PaceContract(power=30.0, deceleration=5.0)


@pytest.mark.parametrize(
    ("previous", "asked", "expected"),
    [
        (10.0, 0.0, 9.94),  # 30 W/kg at 10 m/s: 3 m/s^2, at 50 Hz
        (5.0, 0.0, 4.9),  # 6 m/s^2 would be within the power: the deceleration decides
        (10.0, 9.95, 9.95),  # slower than the limit: as asked
        (10.0, 12.0, 12.0),  # a rise is never limited
        (0.05, -2.0, -0.05),  # through zero, and on at the same rate
        (0.05, 0.0, 0.0),
        (-2.0, 0.0, -1.9),  # backward, the mirror image
        (-2.0, -3.0, -3.0),
        (0.0, -2.0, -2.0),
    ],
)
def test_only_the_fall_is_limited(previous: float, asked: float, expected: float) -> None:
    assert limit_braking(LIMITS, previous, asked, 50.0) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("field", "value"),
    [("power", 0.0), ("power", 1e6), ("deceleration", -1.0), ("deceleration", float("inf")), ("lead", 0.0)],
)
def test_impossible_limits_are_refused(field: str, value: float) -> None:
    with pytest.raises(InvalidValueError, match=f"pace.{field}"):
        PaceContract(**{field: value})


def test_the_contract_carries_them(assert_carried: Callable[..., None]) -> None:
    assert_carried("pace", LIMITS, {"power": 0.0})


def test_the_network_sees_the_limited_command(
    watched_runtime: Callable[..., tuple[PolicyRuntime, Measurement, list[np.ndarray]]],
) -> None:
    runtime, still, seen = watched_runtime(pace=LIMITS)
    for speed in (0.3, 0.0, 0.0, 0.0, 0.0):
        runtime.step(still, np.array([speed, 0.0, 0.0]))
    assert [command[0] for command in seen] == pytest.approx([0.3, 0.2, 0.1, 0.0, 0.0])
    runtime.step(still, np.array([9.0, 0.0, 0.0]))
    runtime.reset()
    runtime.step(still, np.zeros(3))
    assert [command[0] for command in seen[5:]] == pytest.approx([9.0, 0.0])


@pytest.mark.parametrize(
    ("estimated", "asked", "expected"),
    [
        (5.0, 12.0, 8.0),
        (5.0, 7.0, 7.0),
        (5.0, -2.0, -2.0),  # how fast it falls is the braking's matter
        (0.0, 12.0, 3.0),
        (-0.5, 12.0, 3.0),  # pushed back: from rest on
        (-2.0, -9.0, -5.0),  # backward, the mirror image
        (1.0, -9.0, -3.0),
    ],
)
def test_the_command_runs_ahead_by_no_more_than_the_lead(
    estimated: float, asked: float, expected: float
) -> None:
    assert limit_lead(PaceContract(lead=3.0), estimated, asked) == expected
    assert limit_lead(PaceContract(), estimated, asked) == asked
