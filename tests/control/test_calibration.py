"""The network is given another forward command than is commanded, and its estimate is corrected."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

import msgspec
import numpy as np
import pytest
from hypothesis import given, strategies

from sprintlab.control import (
    Measurement,
    PolicyRuntime,
    load_policy,
    shipped_policy,
)
from sprintlab.control.calibration import CalibrationContract, given_speed, true_speed
from sprintlab.core.errors import InvalidValueError
from sprintlab.robots import load_robot

ROWS = {
    "commanded": (5.0, 9.5, 12.4),
    "given": (5.0, 10.0, 13.25),
    "estimated": (2.0, 9.0, 11.3),
    "true": (2.0, 9.5, 12.4),
}
TABLES = CalibrationContract(**ROWS)
WatchedRuntime = Callable[..., tuple[PolicyRuntime, Measurement, list[np.ndarray]]]
FINITE = strategies.floats(allow_nan=False, allow_infinity=False)


@strategies.composite
def tables(draw: strategies.DrawFn) -> CalibrationContract:
    """Any tables that a contract may hold."""
    rows = []
    for lowest in (0.0, 1.0):
        speeds = strategies.floats(lowest, 100.0)
        count = draw(strategies.integers(2, 64))
        first = draw(strategies.lists(speeds, min_size=count, max_size=count, unique=True).map(sorted))
        above = strategies.floats(first[0], 100.0, exclude_min=True) if first[0] < 100.0 else speeds
        rest = draw(strategies.lists(above, min_size=count - 1, max_size=count - 1, unique=True).map(sorted))
        rows += [tuple(first), (first[0], *rest)]
    return CalibrationContract(**dict(zip(ROWS, rows, strict=True)))


@given(tables(), strategies.lists(FINITE, min_size=2, max_size=20).map(sorted))
def test_any_table_gives_finite_speeds_that_rise_and_none_below_its_first_point(
    contract: CalibrationContract, speeds: list[float]
) -> None:
    for convert, places, values in (
        (given_speed, contract.commanded, contract.given),
        (true_speed, contract.estimated, contract.true),
    ):
        converted = [convert(contract, speed) for speed in sorted([*speeds, *places])]
        assert all(map(math.isfinite, converted))
        assert all(below <= above for below, above in pairwise(converted))
        for speed in speeds:
            assert speed > places[0] or convert(contract, speed) == speed
        assert [convert(contract, place) for place in places] == pytest.approx(values)
    assert all(given_speed(contract, speed) <= contract.given[-1] for speed in speeds)


@pytest.mark.parametrize(
    ("row", "speeds", "allowed"),
    [
        ("given", (5.0, 10.0), "3 speeds, as many as commanded"),
        ("given", (5.1, 10.0, 13.25), "first 5 m/s, as of commanded"),
        ("given", (5.0, 10.0, 10.0), "greater than the one before"),
        ("commanded", (5.0,), "2 to 64 speeds"),
        ("commanded", (-1.0, 4.0, 13.0), r"\[0, 100\] m/s"),
        ("true", (2.0, 9.5, math.inf), "finite number"),
    ],
)
def test_impossible_tables_are_refused_by_name(row: str, speeds: tuple[float, ...], allowed: str) -> None:
    with pytest.raises(InvalidValueError, match=rf"calibration\.{row} = .*{allowed}"):
        CalibrationContract(**{**ROWS, row: speeds})


def test_the_contract_carries_them(assert_carried: Callable[..., None]) -> None:
    assert_carried("calibration", TABLES, {**ROWS, "given": [5.0, 4.0, 3.0]})


def commands_of(make: WatchedRuntime, *commands: tuple[float, float, float], **contract: object) -> list:
    runtime, still, seen = make(**contract)
    for command in commands:
        runtime.step(still, np.array(command))
    return seen


def test_the_network_is_given_the_other_command(watched_runtime: WatchedRuntime) -> None:
    asked = [(0.0, 0.0, 0.0), (7.25, 0.3, 0.2), (-2.0, 0.0, 0.0), (20.0, 0.0, 0.0)]
    seen = commands_of(watched_runtime, *asked, calibration=TABLES)
    np.testing.assert_allclose(seen, [(0, 0, 0), (7.5, 0.3, 0.2), (-2, 0, 0), (13.25, 0, 0)])


class _Estimating:
    """A policy that estimates a speed of one's own choice, and keeps what it is handed back."""

    def __init__(self, policy: object, speed: float) -> None:
        self._policy, self.speed, self.handed = policy, speed, list[np.ndarray | None]()

    def __getattr__(self, name: str) -> object:
        return getattr(self._policy, name)

    def decide(self, observation: np.ndarray, previous: np.ndarray | None) -> object:
        self.handed.append(previous)
        decision = self._policy.decide(observation, previous)  # pyright: ignore[reportAttributeAccessIssue]
        estimate = decision.estimate.copy()
        estimate[0, 0] = self.speed
        return decision._replace(estimate=estimate)


def estimating(speed: float, **contract: object) -> tuple[PolicyRuntime, _Estimating, Measurement]:
    """A runtime of ``sprint``, whose network estimates this speed, and a robot that stands still."""
    policy, robot = load_policy(shipped_policy()), load_robot("bp2")
    policy.contract = msgspec.structs.replace(policy.contract, **contract)
    watched, pose = _Estimating(policy, speed), np.asarray(robot.default_pose, dtype=float)
    still = Measurement(np.zeros(3), np.array([0.0, 0.0, -1.0]), pose, np.zeros(pose.size))
    return PolicyRuntime(watched, robot), watched, still  # pyright: ignore[reportArgumentType]


def test_who_asks_gets_the_corrected_estimate_and_the_network_its_own() -> None:
    runtime, watched, still = estimating(9.0, calibration=TABLES)
    assert runtime.last_estimate is None
    for _ in range(3):
        runtime.step(still, np.array([9.5, 0.0, 0.0]))
    told, handed = runtime.last_estimate, watched.handed[-1]
    assert told is not None and handed is not None and told.dtype == handed.dtype
    assert (told[0], handed[0, 0]) == (pytest.approx(9.5), 9.0)
    np.testing.assert_array_equal(runtime.last_estimate, told)  # looked at twice, corrected once
    assert np.isfinite(told).all() and told.shape == (8,)
