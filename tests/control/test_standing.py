"""Standing still: when the default pose takes over, and when the policy gets the robot back."""

import msgspec
import numpy as np
import pytest

from sprintlab.control import decode_contract, encode_contract
from sprintlab.control.standing import REST_COMMAND, StandingContract, StandingHold
from sprintlab.core.errors import InvalidValueError

STILL, REST, UPRIGHT = np.zeros(3), np.zeros(3), np.array([0.0, 0.0, -1.0])


MOVING = np.array([2.0, 0.0, 0.0])


@pytest.fixture
def hold() -> StandingHold:
    """The hold of a robot that has run."""
    hold = StandingHold(StandingContract(), rate_hz=50.0)
    assert hold.share(MOVING, MOVING, UPRIGHT) == 1.0
    return hold


def test_a_standing_robot_is_blended_into_its_default_pose(hold):
    shares = [hold.share(REST, STILL, UPRIGHT) for _ in range(150)]
    assert shares == sorted(shares, reverse=True)
    assert shares[14] == pytest.approx(np.exp(-1.0))  # after one time constant
    assert shares[-1] < 1e-4


@pytest.mark.parametrize("index", [0, 1, 2])
def test_any_command_gives_the_robot_back_at_once(hold, index):
    for _ in range(50):
        hold.share(REST, STILL, UPRIGHT)
    command = REST.copy()
    command[index] = -2 * REST_COMMAND
    assert hold.share(command, STILL, UPRIGHT) == 1.0
    assert hold.share(REST, STILL, UPRIGHT) > 0.8, "and the blend begins anew"


def test_a_running_robot_is_not_held(hold):
    assert all(hold.share(REST, np.array([0.7, 0.0, 0.0]), UPRIGHT) == 1.0 for _ in range(50))


def test_a_held_robot_is_let_go_when_it_tips_and_not_when_its_estimate_errs(hold):
    for _ in range(50):
        hold.share(REST, STILL, UPRIGHT)
    assert hold.share(REST, np.array([0.9, 0.0, 0.0]), UPRIGHT) < 0.1
    tipped = np.array([0.0, np.sin(0.25), -np.cos(0.25)])
    assert hold.share(REST, STILL, tipped) == 1.0
    assert hold.share(REST, np.array([0.9, 0.0, 0.0]), UPRIGHT) == 1.0, (
        "then the policy has to slow down anew"
    )


def test_after_a_reset_a_robot_that_is_asked_to_stand_is_held_at_once(hold):
    hold.reset()
    assert hold.share(REST, STILL, UPRIGHT) == 0.0
    hold.reset()
    assert hold.share(MOVING, STILL, UPRIGHT) == 1.0
    assert hold.share(REST, STILL, UPRIGHT) > 0.8


@pytest.mark.parametrize(
    ("field", "values"),
    [
        ("hold_speed", {"hold_speed": 0.0}),
        ("release_tilt", {"release_tilt": 2.0}),
        ("blend_time", {"blend_time": float("nan")}),
    ],
)
def test_impossible_holds_are_refused(field, values):
    with pytest.raises(InvalidValueError, match=f"standing.{field}"):
        StandingContract(**values)


def test_the_contract_carries_it(contract):
    standing = msgspec.structs.replace(contract, standing=StandingContract(hold_speed=0.3))
    assert decode_contract(encode_contract(standing)) == standing
