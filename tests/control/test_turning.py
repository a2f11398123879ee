"""The network is asked for the yaw rate that makes the robot turn as it is told."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sprintlab.control import Measurement, PolicyRuntime
from sprintlab.control.turning import TurningContract, TurningLoop
from sprintlab.core.errors import InvalidValueError

CONTRACT = TurningContract(doubling_speed=12.0, smoothing=0.0, integral=2.0, limit=1.25)


@pytest.mark.parametrize(
    ("forward", "asked", "measured", "expected"),
    [
        (12.0, 0.3, 0.3, 0.6),  # no error: twice what is commanded, at the doubling speed
        (6.0, 0.4, 0.4, 0.5),
        (-6.0, 0.4, 0.4, 0.5),  # backward alike
        (12.0, 0.3, 0.1, 0.6 + 2.0 * 0.2 / 50.0),  # and the integral of what is missing
        (0.0, 0.5, 0.4, 0.5 + 2.0 * 0.1 / 50.0),  # on the spot too
        (12.0, 0.05, 0.0, 0.05),  # straight on: as it is commanded
        (10.0, 1.0, 0.5, 0.5 + 0.5 * 100.0 / 144.0),  # no harder turn than 5 m/s^2
        (4.0, 1.2, 1.2, 1.25),  # and no more than 1.25 rad/s
        (12.75, 0.3, 0.3, 0.3 + 0.5 * 0.3 * (12.75 / 12.0) ** 2),  # half way to where it has faded
        (13.0, 0.3, 0.1, 0.3),  # at the top speed as it is commanded
    ],
)
def test_one_step(forward: float, asked: float, measured: float, expected: float) -> None:
    assert TurningLoop(CONTRACT, 50.0).step(forward, asked, measured) == pytest.approx(expected)


@pytest.mark.parametrize(("share", "offset"), [(0.35, 0.0), (0.7, -0.15), (1.1, 0.1)])
def test_a_robot_that_turns_too_little_or_to_one_side_turns_as_told(share: float, offset: float) -> None:
    """Its yaw rate follows what the network is asked for within 0.2 s."""
    loop, measured = TurningLoop(CONTRACT, 50.0), 0.0
    for _ in range(200):
        wanted = share * loop.step(10.0, 0.3, measured) + offset
        measured += (wanted - measured) / 10.0
    assert measured == pytest.approx(0.3, abs=0.02)


@given(*[st.floats(allow_nan=False, allow_infinity=False)] * 3, st.sampled_from((0.0, 2.0)))
def test_any_numbers_give_a_yaw_rate_within_the_limit(
    forward: float, asked: float, measured: float, integral: float
) -> None:
    loop = TurningLoop(TurningContract(smoothing=0.0, integral=integral), 50.0)
    for _ in range(2):
        assert abs(loop.step(forward, asked, measured)) <= 1.25


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("doubling_speed", 0.0),
        ("integral", -1.0),
        ("integral", float("nan")),
        ("limit", float("inf")),
        ("fastest", -1.0),
    ],
)
def test_impossible_numbers_are_refused(field: str, value: float) -> None:
    with pytest.raises(InvalidValueError, match=f"turning.{field}"):
        TurningContract(**{field: value})


def test_the_contract_carries_them(assert_carried: Callable[..., None]) -> None:
    assert_carried("turning", CONTRACT, {"limit": 0.0})


def test_the_network_is_asked_for_more(
    watched_runtime: Callable[..., tuple[PolicyRuntime, Measurement, list[np.ndarray]]],
) -> None:
    runtime, still, seen = watched_runtime(turning=CONTRACT)
    for _ in range(2):
        runtime.step(still, np.array([12.0, 0.0, 0.3]))
    runtime.reset()
    runtime.step(still._replace(angular_velocity=np.array([0.0, 0.0, 0.3])), np.array([12.0, 0.0, 0.3]))
    assert [command[2] for command in seen] == pytest.approx([0.612, 0.624, 0.6])
