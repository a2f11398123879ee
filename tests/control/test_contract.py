import json
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from sprintlab.control import (
    ESTIMATE_TERMS,
    LowPass,
    ObservationLayout,
    check_contract,
    decode_contract,
    encode_contract,
    make_contract,
)
from sprintlab.core.errors import ContractMismatchError, InvalidValueError, PolicyFileError


def set_entry(vector, index, value):
    changed = list(vector)
    changed[index] = value
    return tuple(changed)


def with_observation(contract, **changes):
    return {"observation": msgspec.structs.replace(contract.observation, **changes)}


def with_term(contract, index, **changes):
    terms = set_entry(
        contract.observation.terms,
        index,
        msgspec.structs.replace(contract.observation.terms[index], **changes),
    )
    return with_observation(contract, terms=terms)


def estimating(contract, terms):
    filters = msgspec.structs.replace(contract.filters, estimate_cutoff_hz=3.0)
    return {"filters": filters, "estimate": terms}


MOTOR_COLUMNS = (
    "pole_pairs",
    "stator_resistance",
    "q_axis_inductance",
    "flux_linkage",
    "peak_torque",
    "saturation",
    "rotor_inertia",
    "gear_ratio",
    "gear_efficiency",
)


def test_contract_matches_the_robot_it_was_made_for(contract, robot):
    check_contract(contract, robot)


def test_contract_survives_its_json_exactly(contract, robot):
    again = decode_contract(encode_contract(contract))
    assert again == contract
    check_contract(again, robot)


def test_contract_tells_layout_filter_and_training(robot, contract):
    layout = ObservationLayout(command_scale=(0.1, 0.2, 0.3), joint_velocity_scale=0.07, history_length=3)
    made = make_contract(
        robot,
        layout=layout,
        training=contract.training,
        software={"numpy": np.__version__},
        proprioception_filter=LowPass(cutoff_hz=8.0),
    )
    assert made.layout == layout.for_joints(12)
    assert made.proprioception_filter == LowPass(cutoff_hz=8.0)
    assert made.training.seed == 3
    assert made.software["numpy"] == np.__version__


@pytest.mark.parametrize(
    ("change", "field"),
    [
        (lambda c: {"format_version": 2}, "format_version"),
        (lambda c: {"policy_rate_hz": 100.0}, "policy_rate_hz"),
        (lambda c: {"motor_rate_hz": 500.0}, "motor_rate_hz"),
        (lambda c: {"robot_name": "bp3"}, "robot_name"),
        (lambda c: {"joint_names": c.joint_names[::-1]}, "joint_names"),
        (lambda c: {"default_pose": set_entry(c.default_pose, 4, 0.71)}, "default_pose[FR_hip]"),
        (lambda c: {"action_scale": set_entry(c.action_scale, 0, 0.3)}, "action_scale[FL_abad]"),
        (lambda c: {"stiffness": set_entry(c.stiffness, 11, 150.0)}, "stiffness[RR_knee]"),
        (lambda c: {"damping": set_entry(c.damping, 6, 5.0)}, "damping[RL_abad]"),
        (lambda c: {"robot_fingerprint": "0" * 12}, "robot_fingerprint"),
        (lambda c: with_term(c, 0, name="gyro"), "observation.terms"),
        (lambda c: with_term(c, 3, scales=(1.0,) * 11), "observation.terms"),
        (lambda c: with_term(c, 4, scales=(0.05,) * 11 + (0.06,)), "observation.joint_velocity scales"),
        (
            lambda c: {
                "observation": msgspec.structs.replace(c.observation, terms=c.observation.terms[::-1])
            },
            "observation.terms",
        ),
        (
            lambda c: with_observation(c, history_order="newest-first"),
            "observation.history_order",
        ),
        (lambda c: with_observation(c, terms=c.observation.terms[:-1]), "observation.terms"),
        (
            lambda c: {"position_limits": set_entry(c.position_limits, 2, (-2.6, -0.2))},
            "position_limits[FL_knee]",
        ),
        (lambda c: {"estimate": ESTIMATE_TERMS}, "estimate"),
        (lambda c: estimating(c, ESTIMATE_TERMS[::-1]), "estimate"),
        (lambda c: estimating(c, ESTIMATE_TERMS[:2]), "estimate"),
    ],
)
def test_every_mismatch_is_refused_by_name(contract, robot, change, field):
    changed = msgspec.structs.replace(contract, **change(contract))
    with pytest.raises(ContractMismatchError) as caught:
        check_contract(changed, robot)
    assert str(caught.value).startswith(f"{field} differs: ")


@pytest.mark.parametrize("column", MOTOR_COLUMNS)
def test_every_motor_number_is_compared(contract, robot, column):
    value = getattr(contract.motors, column)[7]
    changed_vector = set_entry(getattr(contract.motors, column), 7, value * 1.001)
    motors = msgspec.structs.replace(contract.motors, **{column: changed_vector})
    with pytest.raises(ContractMismatchError) as caught:
        check_contract(msgspec.structs.replace(contract, motors=motors), robot)
    message = str(caught.value)
    assert message.startswith(f"motors.{column}[RL_hip] differs: ")
    assert repr(value * 1.001) in message and repr(value) in message


def test_bus_voltage_is_compared_with_both_values(contract, robot):
    motors = msgspec.structs.replace(contract.motors, bus_voltage=48.0)
    with pytest.raises(ContractMismatchError, match=r"motors\.bus_voltage .* 48\.0, robot bp2 has 60\.0"):
        check_contract(msgspec.structs.replace(contract, motors=motors), robot)


def test_a_contract_with_an_estimator_names_its_terms_and_filter(robot, contract):
    made = make_contract(
        robot,
        layout=ObservationLayout(),
        training=contract.training,
        software={},
        proprioception_filter=LowPass(),
        estimate_filter=LowPass(cutoff_hz=3.0),
    )
    check_contract(made, robot)
    assert [(term.name, term.size) for term in made.estimate] == [
        ("body_velocity", 3),
        ("base_height", 1),
        ("foot_contact", 4),
    ]
    assert made.filters.estimate_cutoff_hz == 3.0


def test_a_file_that_does_not_tell_limits_and_estimate_is_read(contract, robot):
    data = json.loads(encode_contract(contract))
    del data["position_limits"], data["estimate"]
    check_contract(decode_contract(json.dumps(data)), robot)


def test_a_training_without_a_hash_of_its_configuration_is_refused(contract):
    data = json.loads(encode_contract(contract))
    data["training"]["config_hash"] = "unknown"
    with pytest.raises(PolicyFileError, match="64 hexadecimal digits"):
        decode_contract(json.dumps(data))


def test_a_heavier_robot_is_another_robot(contract, robot):
    with pytest.raises(ContractMismatchError, match="robot_fingerprint"):
        check_contract(contract, replace(robot, total_mass=robot.total_mass + 1.0))


@pytest.mark.parametrize(
    "change",
    [
        {"stiffness": (160.0,) * 11},
        {"default_pose": (float("nan"),) * 12},
        {"position_limits": ()},
        {"position_limits": ((-1.0, 1.0),) * 11},
        {"action_limit": 0.0},
        {"action_limit": 1e308},
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
        ({"stiffness": "160"}, "stiffness"),
        ({"stiffness": [160.0]}, "stiffness"),
        ({"seed": None}, "seed"),
    ],
)
def test_unreadable_contracts_are_refused_with_the_reason(contract, change, words):
    data = json.loads(encode_contract(contract)) | change
    with pytest.raises(PolicyFileError, match=words):
        decode_contract(json.dumps(data))


def test_missing_field_and_broken_json_are_refused(contract):
    data = json.loads(encode_contract(contract))
    del data["damping"]
    with pytest.raises(PolicyFileError, match="damping"):
        decode_contract(json.dumps(data))
    with pytest.raises(PolicyFileError, match="cannot be read"):
        decode_contract(encode_contract(contract)[:-20])
