import json

import msgspec
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from sprintlab.control import (
    ESTIMATE_TERMS,
    check_contract,
    decode_contract,
    encode_contract,
)
from sprintlab.control.contract import MotorTable
from sprintlab.core.errors import ContractMismatchError, InvalidValueError, PolicyFileError


def set_entry(vector, index, value):
    changed = list(vector)
    changed[index] = value
    return tuple(changed)


def with_observation(contract, **changes):
    return {"observation": msgspec.structs.replace(contract.observation, **changes)}


def with_term(contract, index, **changes):
    terms = contract.observation.terms
    changed = msgspec.structs.replace(terms[index], **changes)
    return with_observation(contract, terms=set_entry(terms, index, changed))


def estimating(contract, terms):
    filters = msgspec.structs.replace(contract.filters, estimate_cutoff_hz=3.0)
    return {"filters": filters, "estimate": terms}


def test_contract_survives_its_json_exactly(contract, robot):
    again = decode_contract(encode_contract(contract))
    assert again == contract
    check_contract(again, robot)


@pytest.mark.parametrize(
    ("change", "field"),
    [
        (lambda c: {"format_version": 3}, "format_version"),
        (lambda c: {"policy_rate_hz": 100.0}, "policy_rate_hz"),
        (lambda c: {"robot_name": "bp3"}, "robot_name"),
        (lambda c: {"joint_names": c.joint_names[::-1]}, "joint_names"),
        (lambda c: {"default_pose": set_entry(c.default_pose, 4, 0.71)}, "default_pose[FR_hip]"),
        (lambda c: {"stiffness": set_entry(c.stiffness, 11, 150.0)}, "stiffness[RR_knee]"),
        (lambda c: {"robot_fingerprint": "0" * 12}, "robot_fingerprint"),
        (lambda c: with_term(c, 4, scales=(0.05,) * 11), "observation.joint_velocity numbers"),
        (lambda c: with_term(c, 4, name="joint_speed"), "observation.terms"),
        (lambda c: with_observation(c, history_order="newest-first"), "observation.history_order"),
        (lambda c: {"position_limits": ((-2.6, 0.0), *c.position_limits[1:])}, "position_limits[FL_abad]"),
        (lambda c: estimating(c, ESTIMATE_TERMS[::-1]), "estimate"),
    ],
)
def test_every_mismatch_is_refused_by_name(contract, robot, change, field):
    changed = msgspec.structs.replace(contract, **change(contract))
    with pytest.raises(ContractMismatchError) as caught:
        check_contract(changed, robot)
    assert str(caught.value).startswith(f"{field} differs: ")


@pytest.mark.parametrize(
    "change",
    [
        {"stiffness": (160.0,) * 11},
        {"default_pose": (float("nan"),) * 12},
        {"position_limits": ((-1.0, 1.0),) * 11},
        {"policy_rate_hz": float("inf")},
    ],
)
def test_impossible_contracts_are_refused(contract, change):
    fields = {name: getattr(contract, name) for name in contract.__struct_fields__}
    with pytest.raises(InvalidValueError):
        type(contract)(**(fields | change))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"format_version": 99}, "format 99"),
        ({"unheard_of": 1}, "unheard_of"),
        ({"stiffness": [160.0]}, "stiffness"),
    ],
)
def test_unreadable_contracts_are_refused_with_the_reason(contract, change, words):
    data = json.loads(encode_contract(contract)) | change
    with pytest.raises(PolicyFileError, match=words):
        decode_contract(json.dumps(data))


@given(st.sampled_from(MotorTable.__struct_fields__), st.integers(0, 11))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=30)
def test_every_motor_number_is_compared(contract, robot, column, joint):
    value = getattr(contract.motors, column)
    if column == "bus_voltage":
        changed, place = 1.001 * value, column
    else:
        changed = set_entry(value, joint, 1.001 * value[joint] + 1e-9)
        place = f"{column}[{robot.joint_names[joint]}]"
    motors = msgspec.structs.replace(contract.motors, **{column: changed})
    with pytest.raises(ContractMismatchError) as caught:
        check_contract(msgspec.structs.replace(contract, motors=motors), robot)
    assert str(caught.value).startswith(f"motors.{place} differs: ")
