"""A recorded rollout against its motors: made so that the right answer is known."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import sprintlab as sl
from sprintlab.cli.main import main
from sprintlab.core.errors import InvalidValueError
from sprintlab.evaluation.rollout_audit import audit_rollout, joint_envelope
from sprintlab.evaluation.rollouts import Rollout, load_rollout
from sprintlab.motors import library_motors, load_library_motor, no_load_speed
from sprintlab.robots import JointMotors, match_joints, robot_motors

ACTUATOR = load_library_motor(library_motors()[0])
MOTORS = JointMotors(motor=ACTUATOR.motor, gear=ACTUATOR.gear, bus_voltage=ACTUATOR.bus_voltage)
COUNT = 1000
LEGS = ("FL", "FR", "RL", "RR")


@pytest.fixture
def rollout():
    """Two joints inside the envelope, a foot that stands 0.1 s of every 0.2 s and slides at 0.05 m/s."""
    time = np.arange(COUNT) / 1000.0
    top = float(no_load_speed(MOTORS.motor, MOTORS.bus_voltage)) / float(MOTORS.gear.ratio)
    phase = 2.0 * np.pi * time[:, None] + np.array([0.0, 1.0])
    velocity = 0.9 * top * np.sin(phase)
    lower, upper = joint_envelope(MOTORS, velocity)
    share = 0.5 + 0.49 * np.cos(3.0 * phase)
    contact = ((np.arange(COUNT) // 100) % 2 == 1).astype(float)[:, None]
    return Rollout(
        time=time,
        joint_velocity=velocity,
        joint_torque=lower + share * (upper - lower),
        joint_names=("hip", "knee"),
        base_velocity=np.tile([3.0, 0.0], (COUNT, 1)),
        foot_contact=contact,
        foot_velocity=np.tile([[[0.05, 0.0]]], (COUNT, 1, 1)),
    )


def test_what_lies_inside_the_envelope_is_possible(rollout):
    verdict = audit_rollout(rollout, MOTORS)
    assert verdict.impossible == 0.0 and "can give every torque" in verdict.sentence
    assert verdict.speed == pytest.approx(3.0)
    assert max(joint.speed_ratio for joint in verdict.joints) == pytest.approx(0.9, abs=1e-3)


def test_every_impossible_sample_is_counted(rollout):
    lower, upper = joint_envelope(MOTORS, rollout.joint_velocity)
    torque = rollout.joint_torque.copy()
    torque[:140, 1] = upper[:140, 1] + 5.0
    torque[140:200, 1] = lower[140:200, 1] - 2.0
    verdict = audit_rollout(replace(rollout, joint_torque=torque), MOTORS)
    hip, knee = verdict.joints
    assert (hip.impossible, knee.impossible) == (0.0, pytest.approx(0.2))
    assert verdict.impossible == pytest.approx(0.1) and verdict.impossible_moments == pytest.approx(0.2)
    assert knee.largest_excess == pytest.approx(5.0)
    assert "10 % of the time (knee: 20 %, up to 5.0 N m too much)" in verdict.sentence


def test_torque_that_only_v_d_forbids_is_told_apart(rollout):
    velocity = rollout.joint_velocity
    _, refined = joint_envelope(MOTORS, velocity)
    _, without = joint_envelope(MOTORS, velocity, "simplified-dc")
    verdict = audit_rollout(replace(rollout, joint_torque=0.5 * (refined + without)), MOTORS)
    for joint in verdict.joints:
        assert joint.v_d_only == joint.impossible
    assert verdict.impossible > 0.0


def robot_rollout(seed=0):
    """A go1 in its own joint order, each joint with another share of impossible torque."""
    motors = robot_motors("go1")
    generator = np.random.default_rng(seed)
    velocity = generator.uniform(-15.0, 15.0, (400, 12))
    _, upper = joint_envelope(motors, velocity)
    torque = 0.5 * upper
    for joint in range(12):
        torque[: 20 * joint, joint] = upper[: 20 * joint, joint] + 1.0 + joint
    return Rollout(
        time=0.002 * np.arange(400), joint_velocity=velocity, joint_torque=torque, joint_names=motors.names
    )


def in_order(rollout, order, names):
    columns = {name: getattr(rollout, name)[:, order] for name in ("joint_velocity", "joint_torque")}
    return replace(rollout, joint_names=tuple(names[at] for at in order), **columns)


UNITREE = [f"{leg}_{joint}_joint" for leg in LEGS for joint in ("hip", "thigh", "calf")]
ANYMAL = [f"{leg}_{joint}" for leg in ("LF", "RF", "LH", "RH") for joint in ("HAA", "HFE", "KFE")]
TYPE_MAJOR = [3 * leg + joint for joint in range(3) for leg in range(4)]


@settings(max_examples=25, deadline=None)
@given(
    order=st.one_of(st.just(list(range(12))), st.just(TYPE_MAJOR), st.permutations(range(12))),
    names=st.sampled_from([list(robot_motors("go1").names), UNITREE, ANYMAL]),
)
def test_every_order_of_joints_gives_the_same_verdict_per_joint(order, names):
    rollout, motors = robot_rollout(), robot_motors("go1")
    expected = audit_rollout(rollout, motors)
    verdict = audit_rollout(in_order(rollout, order, names), motors)
    by_name = {joint.name: joint for joint in verdict.joints}
    for at, joint in enumerate(expected.joints):
        assert by_name[names[at]] == replace(joint, name=names[at])
    worst = max(verdict.joints, key=lambda joint: joint.impossible)
    assert worst.name == names[11] and worst.impossible == pytest.approx(220 / 400)
    assert verdict.impossible == pytest.approx(expected.impossible)


def saved(path, rollout, **changes):
    """The rollout as NPZ; ``None`` leaves an array out."""
    fields = ("time", "joint_velocity", "joint_torque", "joint_names", "base_velocity", "foot_contact",
              "foot_velocity", "foot_names")  # fmt: skip
    arrays = {name: getattr(rollout, name) for name in fields} | changes
    np.savez(
        path, **{name: values for name, values in arrays.items() if np.size(values) and values is not None}
    )
    return path


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (["FL_hip"] * 2 + UNITREE[2:], "FL_hip"),
        (["arm_0", *UNITREE[1:]], "arm_0, FL_thigh_joint.*FL_abad, FL_hip, FL_knee"),
        (UNITREE[:11], "11 names"),
    ],
    ids=["repeated", "unknown", "too-few"],
)
def test_names_that_fit_no_motor_are_refused_with_both_lists(tmp_path, names, message):
    path = saved(tmp_path / "a.npz", robot_rollout(), joint_names=np.array(names))
    with pytest.raises(InvalidValueError, match=message):
        sl.audit_rollout(path, motor="go1")


def test_without_names_the_assumed_order_is_printed(tmp_path):
    found = sl.audit_rollout(saved(tmp_path / "a.npz", robot_rollout(), joint_names=None), motor="go1")
    assert "assumed order of joints: FL_abad, FL_hip, FL_knee, FR_abad" in str(found).replace("\n", " ")
    assert found.to_dict()["assumed_order"] == list(robot_motors("go1").names)
    named = sl.audit_rollout(saved(tmp_path / "b.npz", robot_rollout()), motor="go1")
    assert named.found == found.found and "assumed" not in str(named)


def write_csv(path, rollout):
    """The tables in opposite orders: columns belong together by name."""
    columns = {"time": rollout.time}
    for at, name in enumerate(rollout.joint_names):
        columns[f"joint_velocity_{name}"] = rollout.joint_velocity[:, at]
    for at, name in reversed(list(enumerate(rollout.joint_names))):
        columns[f"joint_torque_{name}"] = rollout.joint_torque[:, at]
    columns["base_velocity_x"], columns["base_velocity_y"] = rollout.base_velocity.T
    columns["foot_velocity_FL_y"], columns["foot_velocity_FL_x"] = rollout.foot_velocity[:, 0, ::-1].T
    columns["foot_contact_FL"] = rollout.foot_contact[:, 0]
    table = np.stack(list(columns.values()), axis=1)
    np.savetxt(path, table, delimiter=",", header=",".join(columns), comments="")


def test_csv_npz_and_arrays_give_one_answer(rollout, tmp_path):
    write_csv(tmp_path / "run.csv", rollout)
    saved(tmp_path / "run.npz", rollout)
    expected = audit_rollout(rollout, MOTORS)
    for name in ("run.csv", "run.npz"):
        verdict = audit_rollout(load_rollout(tmp_path / name), MOTORS)
        assert verdict.sentence == expected.sentence
        assert verdict.slip == pytest.approx(expected.slip)
        assert [joint.name for joint in verdict.joints] == ["hip", "knee"]
    assert load_rollout(tmp_path / "run.csv").foot_names == ("FL",)


def test_the_command_answers_and_draws(rollout, tmp_path, capsys):
    write_csv(tmp_path / "run.csv", rollout)
    voltage = str(MOTORS.bus_voltage / 2)
    arguments = ["audit", str(tmp_path / "run.csv"), "--motor", ACTUATOR.name, "--bus-voltage", voltage]
    assert main([*arguments, "--figure", str(tmp_path / "run.svg"), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert 0.0 < answer["impossible"] < 1.0 and "impossible torque" in answer["sentence"]
    assert (tmp_path / "run.svg").read_bytes().startswith(b"<?xml")
    assert main(arguments) == 0
    assert "The policy asks for impossible torque" in capsys.readouterr().out


def test_slip_is_that_of_each_whole_stance():
    """Stances of one sample and of three, one cut off at either end."""
    contact = np.array([1, 0, 1, 0, 1, 1, 1, 0, 0, 1.0])[:, None]
    rollout = Rollout(
        time=np.arange(10.0),
        joint_velocity=np.ones((10, 1)),
        joint_torque=np.ones((10, 1)),
        foot_contact=contact,
        foot_velocity=np.arange(10.0)[:, None, None] * np.array([1.0, 0.0]),
    )
    verdict = audit_rollout(rollout, MOTORS)
    assert (verdict.slip, verdict.stance) == pytest.approx(((2 + 4 + 5 + 6) / 2, 2.0))


def test_hips_alone_may_be_of_either_convention():
    joints = robot_motors("go1").names
    assert match_joints(["RR_calf_joint", "FL_thigh_joint"], joints) == [11, 1]
    with pytest.raises(InvalidValueError, match="abduction or a flexion"):
        match_joints(["FL_hip_joint"], joints)
