"""What becomes of a command before the network sees it: calibration, pace, turning, standing."""

from __future__ import annotations

import math
from itertools import pairwise

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sprintlab.control import PolicyRuntime, load_policy, shipped_policy
from sprintlab.control.calibration import CalibrationContract, given_speed, true_speed
from sprintlab.control.pace import PaceContract, limit_braking, limit_lead
from sprintlab.control.standing import REST_COMMAND, StandingContract, StandingHold
from sprintlab.control.turning import TurningContract, TurningLoop
from sprintlab.core.errors import InvalidValueError
from sprintlab.robots import load_robot

ROWS = {
    "commanded": (5.0, 9.5, 12.4),
    "given": (5.0, 10.0, 13.25),
    "estimated": (2.0, 9.0, 11.3),
    "true": (2.0, 9.5, 12.4),
}
TABLES = CalibrationContract(**ROWS)
LIMITS = PaceContract(power=30.0, deceleration=5.0, lead=3.0)
TURNING = TurningContract(doubling_speed=12.0, smoothing=0.0, integral=2.0, limit=1.25)
FINITE = st.floats(allow_nan=False, allow_infinity=False)
SPEEDS = st.floats(-15.0, 15.0)


@pytest.mark.parametrize(
    ("name", "part", "impossible"),
    [
        ("calibration", TABLES, {**ROWS, "given": [5.0, 4.0, 3.0]}),
        ("pace", LIMITS, {"power": 0.0}),
        ("turning", TURNING, {"limit": 0.0}),
        ("standing", StandingContract(hold_speed=0.3), {"hold_speed": 0.0}),
    ],
)
def test_a_contract_carries_it(assert_carried, name, part, impossible):
    assert_carried(name, part, impossible)


@pytest.mark.parametrize(
    ("contract", "wrong", "sentence"),
    [
        *((PaceContract, {name: 0.0}, f"pace.{name}") for name in ("power", "deceleration", "lead")),
        *((TurningContract, {name: -1.0}, f"turning.{name}") for name in ("integral", "limit", "fastest")),
        (StandingContract, {"release_tilt": 2.0}, "standing.release_tilt"),
        (StandingContract, {"blend_time": math.nan}, "standing.blend_time"),
        (CalibrationContract, {**ROWS, "given": (5.0, 10.0)}, "3 speeds, as many as commanded"),
        (CalibrationContract, {**ROWS, "given": (5.1, 10.0, 13.25)}, "first 5 m/s, as of commanded"),
        (CalibrationContract, {**ROWS, "given": (5.0, 10.0, 10.0)}, "greater than the one before"),
        (CalibrationContract, {**ROWS, "commanded": (5.0,)}, "2 to 64 speeds"),
        (CalibrationContract, {**ROWS, "true": (2.0, 9.5, math.inf)}, "finite number"),
    ],
)
def test_impossible_numbers_are_refused(contract, wrong, sentence):
    with pytest.raises(InvalidValueError, match=sentence):
        contract(**wrong)


# ---- calibration --------------------------------------------------------------------------------------


@given(st.lists(FINITE, min_size=2, max_size=20).map(sorted))
def test_tables_give_finite_speeds_that_rise_and_none_below_their_first_point(speeds):
    for convert, places, values in (
        (given_speed, TABLES.commanded, TABLES.given),
        (true_speed, TABLES.estimated, TABLES.true),
    ):
        converted = [convert(TABLES, speed) for speed in sorted([*speeds, *places])]
        assert all(map(math.isfinite, converted))
        assert all(below <= above for below, above in pairwise(converted))
        assert all(speed > places[0] or convert(TABLES, speed) == speed for speed in speeds)
        assert [convert(TABLES, place) for place in places] == pytest.approx(values)
    assert given_speed(TABLES, speeds[-1]) <= TABLES.given[-1]


def test_the_network_is_given_the_other_command(watched_runtime):
    runtime, still, seen = watched_runtime(calibration=TABLES)
    for command in [(0.0, 0.0, 0.0), (7.25, 0.3, 0.2), (-2.0, 0.0, 0.0), (20.0, 0.0, 0.0)]:
        runtime.step(still, np.array(command))
    np.testing.assert_allclose(seen, [(0, 0, 0), (7.5, 0.3, 0.2), (-2, 0, 0), (13.25, 0, 0)])


def test_who_asks_gets_the_corrected_estimate_and_the_network_its_own(watched_runtime):
    """The network of ``sprint``, which estimates 9 m/s here, whatever it sees."""
    *_, still, _ = watched_runtime()
    policy, handed = load_policy(shipped_policy()), []
    policy.contract, decide = msgspec.structs.replace(policy.contract, calibration=TABLES), policy.decide

    def estimating(observation, previous):
        handed.append(previous)
        decision = decide(observation, previous)
        decision.estimate[0, 0] = 9.0
        return decision

    policy.decide, runtime = estimating, PolicyRuntime(policy, load_robot("bp2"))
    assert runtime.last_estimate is None
    for _ in range(3):
        runtime.step(still, np.array([9.5, 0.0, 0.0]))
    assert (runtime.last_estimate[0], handed[-1][0, 0]) == (pytest.approx(9.5), 9.0)
    assert runtime.last_estimate[0] == pytest.approx(9.5)  # looked at twice, corrected once


# ---- pace ---------------------------------------------------------------------------------------------


@given(SPEEDS, SPEEDS)
def test_only_the_fall_of_the_command_is_limited(previous, asked):
    found = limit_braking(LIMITS, previous, asked, 50.0)
    assert limit_braking(LIMITS, -previous, -asked, 50.0) == -found  # backward, the mirror image
    step = min(5.0, 30.0 / max(abs(previous), 0.1)) / 50.0
    forward = math.copysign(1.0, previous)
    slowest = forward * previous - step if previous else -math.inf
    assert forward * found == pytest.approx(max(forward * asked, slowest))


@given(SPEEDS, SPEEDS)
def test_the_command_runs_ahead_by_no_more_than_the_lead(estimated, asked):
    found = limit_lead(LIMITS, estimated, asked)
    assert min(estimated, 0.0) - 3.0 <= found <= max(estimated, 0.0) + 3.0
    assert found == asked or abs(found) < abs(asked)
    assert limit_lead(PaceContract(), estimated, asked) == asked


def test_the_network_sees_the_limited_command(watched_runtime):
    runtime, still, seen = watched_runtime(pace=PaceContract())
    for speed in (0.3, 0.0, 0.0, 0.0, 9.0):
        runtime.step(still, np.array([speed, 0.0, 0.0]))
    runtime.reset()
    runtime.step(still, np.zeros(3))
    assert [command[0] for command in seen] == pytest.approx([0.3, 0.2, 0.1, 0.0, 9.0, 0.0])


# ---- turning ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("forward", "asked", "measured", "expected"),
    [
        (12.0, 0.3, 0.3, 0.6),  # no error: twice what is commanded, at the doubling speed
        (-6.0, 0.4, 0.4, 0.5),  # backward alike
        (12.0, 0.3, 0.1, 0.6 + 2.0 * 0.2 / 50.0),  # and the integral of what is missing
        (12.0, 0.05, 0.0, 0.05),  # straight on: as it is commanded
        (10.0, 1.0, 0.5, 0.5 + 0.5 * 100.0 / 144.0),  # no harder turn than 5 m/s^2
        (13.0, 0.3, 0.1, 0.3),  # at the top speed as it is commanded
    ],
)
def test_one_step_of_the_turning_loop(forward, asked, measured, expected):
    assert TurningLoop(TURNING, 50.0).step(forward, asked, measured) == pytest.approx(expected)


@pytest.mark.parametrize(("share", "offset"), [(0.35, 0.0), (0.7, -0.15), (1.1, 0.1)])
def test_a_robot_that_turns_too_little_or_to_one_side_turns_as_told(share, offset):
    """Its yaw rate follows what the network is asked for within 0.2 s."""
    loop, measured = TurningLoop(TURNING, 50.0), 0.0
    for _ in range(200):
        wanted = share * loop.step(10.0, 0.3, measured) + offset
        measured += (wanted - measured) / 10.0
    assert measured == pytest.approx(0.3, abs=0.02)


@given(FINITE, FINITE, FINITE)
def test_any_numbers_give_a_yaw_rate_within_the_limit(forward, asked, measured):
    loop = TurningLoop(TURNING, 50.0)
    assert all(abs(loop.step(forward, asked, measured)) <= 1.25 for _ in range(2))


def test_the_network_is_asked_for_more(watched_runtime):
    runtime, still, seen = watched_runtime(turning=TURNING)
    for _ in range(2):
        runtime.step(still, np.array([12.0, 0.0, 0.3]))
    assert [command[2] for command in seen] == pytest.approx([0.612, 0.624])


# ---- standing -----------------------------------------------------------------------------------------

REST, UPRIGHT, MOVING = np.zeros(3), np.array([0.0, 0.0, -1.0]), np.array([2.0, 0.0, 0.0])


@pytest.fixture
def held():
    """The hold of a robot that has run, and has come to rest in its default pose."""
    hold = StandingHold(StandingContract(), rate_hz=50.0)
    shares = [hold.share(MOVING, MOVING, UPRIGHT), *(hold.share(REST, REST, UPRIGHT) for _ in range(150))]
    assert shares == sorted(shares, reverse=True) and shares[0] == 1.0 and shares[-1] < 1e-4
    assert shares[15] == pytest.approx(np.exp(-1.0))  # after one time constant
    return hold


@pytest.mark.parametrize("index", [0, 1, 2])
def test_any_command_gives_the_robot_back_at_once(held, index):
    command = np.where(np.arange(3) == index, -2 * REST_COMMAND, 0.0)
    assert held.share(command, REST, UPRIGHT) == 1.0
    assert held.share(REST, REST, UPRIGHT) > 0.8, "and the blend begins anew"


def test_a_held_robot_is_let_go_when_it_tips_and_not_when_its_estimate_errs(held):
    fast = np.array([0.9, 0.0, 0.0])
    assert held.share(REST, fast, UPRIGHT) < 0.1
    assert held.share(REST, REST, np.array([0.0, np.sin(0.25), -np.cos(0.25)])) == 1.0
    assert held.share(REST, fast, UPRIGHT) == 1.0, "then the policy has to slow down anew"
    held.reset()
    assert held.share(REST, fast, UPRIGHT) == 0.0, "one that is asked to stand from the start is held"
