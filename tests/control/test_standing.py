"""The hold of a robot that is asked to stand, in the contract and at work."""

from __future__ import annotations

import json

import msgspec
import numpy as np
import pytest

from sprintlab.control import encode_contract
from sprintlab.control.contract import decode_contract
from sprintlab.control.standing import REST_COMMAND, StandingContract, StandingHold
from sprintlab.core.errors import PolicyFileError

REST, UPRIGHT, MOVING = np.zeros(3), np.array([0.0, 0.0, -1.0]), np.array([2.0, 0.0, 0.0])


def test_a_contract_carries_it(contract):
    changed = msgspec.structs.replace(contract, standing=StandingContract(hold_speed=0.3))
    assert decode_contract(encode_contract(changed)) == changed
    fields = json.loads(encode_contract(changed))
    with pytest.raises(PolicyFileError, match="standing"):
        decode_contract(json.dumps({**fields, "standing": {"hold_speed": 0.0}}))
    del fields["standing"]
    assert decode_contract(json.dumps(fields)).standing is None


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
