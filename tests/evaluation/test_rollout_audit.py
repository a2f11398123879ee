"""Somebody else's rollout against a motor: made so that the right answer is known."""

import json
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from sprintlab.cli.main import main
from sprintlab.core.errors import InvalidValueError, SprintlabError
from sprintlab.evaluation.rollout_audit import (
    Rollout,
    audit_rollout,
    joint_envelope,
    load_rollout,
    rollout_figure,
)
from sprintlab.motors import library_motors, load_library_motor, no_load_speed

ACTUATOR = load_library_motor(library_motors()[0])
MOTOR, GEAR, BUS = ACTUATOR.motor, ACTUATOR.gear, ACTUATOR.bus_voltage
COUNT = 1000


@pytest.fixture
def rollout():
    """Two joints inside the envelope, a foot that stands 0.1 s of every 0.2 s and slides at 0.05 m/s."""
    time = np.arange(COUNT) / 1000.0
    top = float(no_load_speed(MOTOR, BUS)) / float(GEAR.ratio)
    phase = 2.0 * np.pi * time[:, None] + np.array([0.0, 1.0])
    velocity = 0.9 * top * np.sin(phase)
    lower, upper = joint_envelope(MOTOR, GEAR, BUS, velocity, "refined")
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
    verdict = audit_rollout(rollout, MOTOR, GEAR, BUS)
    assert verdict.impossible == 0.0 and "can give every torque" in verdict.sentence
    assert verdict.speed == pytest.approx(3.0)
    assert max(joint.speed_ratio for joint in verdict.joints) == pytest.approx(0.9, abs=1e-3)


def test_every_impossible_sample_is_counted(rollout):
    lower, upper = joint_envelope(MOTOR, GEAR, BUS, rollout.joint_velocity, "refined")
    torque = rollout.joint_torque.copy()
    torque[:140, 1] = upper[:140, 1] + 5.0
    torque[140:200, 1] = lower[140:200, 1] - 2.0
    verdict = audit_rollout(replace(rollout, joint_torque=torque), MOTOR, GEAR, BUS)
    hip, knee = verdict.joints
    assert (hip.impossible, knee.impossible) == (0.0, pytest.approx(0.2))
    assert verdict.impossible == pytest.approx(0.1) and verdict.impossible_moments == pytest.approx(0.2)
    assert knee.largest_excess == pytest.approx(5.0)
    assert "10 % of the time (knee: 20 %, up to 5.0 N m too much)" in verdict.sentence


def test_torque_that_only_v_d_forbids_is_told_apart(rollout):
    velocity = rollout.joint_velocity
    _, refined = joint_envelope(MOTOR, GEAR, BUS, velocity, "refined")
    _, without = joint_envelope(MOTOR, GEAR, BUS, velocity, "simplified-dc")
    verdict = audit_rollout(replace(rollout, joint_torque=0.5 * (refined + without)), MOTOR, GEAR, BUS)
    for joint in verdict.joints:
        assert joint.v_d_only == joint.impossible
    assert verdict.impossible > 0.0


def test_over_speed_is_counted(rollout):
    fast = replace(
        rollout, joint_velocity=rollout.joint_velocity * 2.0, joint_torque=0.0 * rollout.joint_torque
    )
    verdict = audit_rollout(fast, MOTOR, GEAR, BUS)
    share = np.mean(np.abs(1.8 * np.sin(2.0 * np.pi * rollout.time)) > 1.0)
    assert verdict.joints[0].over_speed == pytest.approx(share)


def test_stances_and_slip(rollout):
    verdict = audit_rollout(rollout, MOTOR, GEAR, BUS, policy_rate=20.0)
    assert verdict.stance == pytest.approx(0.1)
    assert verdict.stance_periods == pytest.approx(2.0)
    assert verdict.slip == pytest.approx(0.005)


def write_csv(path, rollout):
    names = ["time"]
    columns = [rollout.time[:, None], rollout.joint_velocity, rollout.joint_torque, rollout.base_velocity]
    names += [f"joint_velocity_{name}" for name in rollout.names]
    names += [f"joint_torque_{name}" for name in rollout.names]
    names += [
        "base_velocity_x",
        "base_velocity_y",
        "foot_contact_FL",
        "foot_velocity_FL_x",
        "foot_velocity_FL_y",
    ]
    columns += [rollout.foot_contact, rollout.foot_velocity.reshape(COUNT, -1)]
    np.savetxt(path, np.hstack(columns), delimiter=",", header=",".join(names), comments="")


def test_csv_npz_and_arrays_give_one_answer(rollout, tmp_path):
    write_csv(tmp_path / "run.csv", rollout)
    fields = ("time", "joint_velocity", "joint_torque", "base_velocity", "foot_contact", "foot_velocity")
    arrays = {name: getattr(rollout, name) for name in fields}
    np.savez(tmp_path / "run.npz", joint_names=np.array(rollout.names), **arrays)
    expected = audit_rollout(rollout, MOTOR, GEAR, BUS)
    for name in ("run.csv", "run.npz"):
        verdict = audit_rollout(load_rollout(tmp_path / name), MOTOR, GEAR, BUS)
        assert verdict.sentence == expected.sentence
        assert verdict.slip == pytest.approx(expected.slip)
        assert [joint.name for joint in verdict.joints] == ["hip", "knee"]


def test_the_command_answers_and_draws(rollout, tmp_path, capsys):
    write_csv(tmp_path / "run.csv", rollout)
    arguments = ["audit", str(tmp_path / "run.csv"), "--motor", ACTUATOR.name, "--bus-voltage", str(BUS / 2)]
    assert main([*arguments, "--figure", str(tmp_path / "run.svg"), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert 0.0 < answer["impossible"] < 1.0 and "impossible torque" in answer["sentence"]
    assert (tmp_path / "run.svg").read_bytes().startswith(b"<?xml")
    assert main(arguments) == 0
    assert "The policy asks for impossible torque" in capsys.readouterr().out


def test_the_picture_has_a_panel_a_joint(rollout):
    figure = rollout_figure(rollout, MOTOR, GEAR, BUS)
    assert [axis.get_title("left") for axis in figure.axes] == ["hip", "knee"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time,joint_velocity_0\n0,1\n1,2\n", "joint_torque must be among them"),
        ("time,joint_velocity_0,joint_torque_0\n0,1,1\n0,1,1\n", "rising"),
        ("time,joint_velocity_0,joint_torque_0\n0,1,nan\n1,1,1\n", "finite"),
        ("time,joint_velocity_0,joint_torque_0\n0,1\n1,1,1\n", "needs 3 numbers"),
        ("time,joint_velocity_0,joint_torque_0\n0,1,1\n1,1,x\n", "is not a table of numbers"),
        ("time,joint_velocity_0,joint_torque_0\n0,1,1\n1,1_0,1\n", "line 3, column joint_velocity_0: '1_0'"),
        ("time,joint_velocity_0,joint_torque_0\n0,1,1\n\n1,1e400,1\n", "line 4, column joint_velocity_0"),
        ("time,joint_velocity_0,joint_torque_0\n0,1,1\n１,1,1\n", "line 3, column time: '１' is no"),
        ("time,joint_velocity_0,time,joint_torque_0\n0,1,9,1\n1,1,8,1\n", "one of them twice"),
        ("time\n", "no header and two samples"),
        ("time,joint_velocity_0,joint_torque_0\r0,1,1\r1,1,1\r", "no CSV file"),
        (f"time,joint_velocity_0,joint_torque_0\n0,1,1\n1,1,{' ' * 200_000}1\n", "no CSV file"),
    ],
    ids=[
        "no-torque",
        "time",
        "nan",
        "short-row",
        "text",
        "underscore",
        "huge",
        "full-width",
        "twice",
        "header",
        "carriage-returns",
        "long-cell",
    ],
)
def test_unusable_recordings_are_refused(tmp_path, text, message):
    (tmp_path / "run.csv").write_text(text)
    with pytest.raises(SprintlabError, match=message):
        load_rollout(tmp_path / "run.csv")


def test_a_csv_of_any_size_takes_little_memory(tmp_path, monkeypatch):
    """As texts the cells of the largest CSV, let alone of half a gigabyte, took all of the memory."""
    path = tmp_path / "run.csv"
    path.write_text("time,joint_velocity_0,joint_torque_0\n" + "\n" * 1_000_000 + "1,1,1\n" * 300_000)
    tracemalloc.start()
    try:
        with pytest.raises(InvalidValueError, match="300000 samples"):
            load_rollout(path)
        assert tracemalloc.get_traced_memory()[1] < 60_000_000
    finally:
        tracemalloc.stop()
    path.write_text(",".join(["time"] * 2001) + "\n")
    with pytest.raises(SprintlabError, match="more than 2000 columns"):
        load_rollout(path)
    with path.open("wb") as file:
        file.truncate((32 << 20) + 1)
    with pytest.raises(SprintlabError, match="larger than 32 MB"):
        load_rollout(path)


def test_another_kind_of_file_is_refused(tmp_path):
    with pytest.raises(SprintlabError, match=r"\.csv, \.npz or \.mcap"):
        load_rollout(tmp_path / "run.pkl")


def test_as_many_motors_as_joints(rollout, robot):
    with pytest.raises(InvalidValueError, match="12 motors"):
        audit_rollout(rollout, robot.motors, robot.gear, 60.0)


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"joint_torque": np.full((9, 2), 1.7e308)}, "joint_torque = 'a larger number'"),
        ({"joint_velocity": np.full((9, 2), np.longdouble(10) ** 4000)}, "NaN or infinity"),
        ({"time": np.array([*range(7), np.inf, np.inf])}, "time = 'NaN or infinity'"),
        ({"joint_names": ["one"]}, "one for each of 2"),
        ({"joint_names": ["one", "x" * 100_000]}, "at most 100 characters"),
        ({"joint_velocity": np.zeros((9, 201)), "joint_torque": np.zeros((9, 201))}, "at most 200"),
        ({"foot_contact": np.eye(9), "foot_velocity": np.zeros((9, 2, 2))}, "samples, feet"),
        ({"foot_contact": np.zeros((9, 201))}, "at most 200 feet"),
    ],
    ids=["torque", "longdouble", "time", "too-few-names", "long-name", "joints", "other-feet", "many-feet"],
)
def test_what_no_robot_records_is_refused(tmp_path, change, match, recwarn):
    sound = {"time": np.arange(9.0), "joint_velocity": np.ones((9, 2)), "joint_torque": np.ones((9, 2))}
    np.savez(tmp_path / "a.npz", **(sound | change))
    with pytest.raises(InvalidValueError, match=match):
        load_rollout(tmp_path / "a.npz")
    assert not recwarn.list


@pytest.mark.parametrize(
    "change",
    [
        {"time": np.float64(1.0)},
        {"joint_names": np.array("hip")},
        {"joint_velocity": np.ones((9, 2, 2)), "joint_torque": np.ones((9, 2, 2))},
        {"joint_velocity": np.ones((9, 0)), "joint_torque": np.ones((9, 0))},
        {"base_velocity": np.ones((9, 0))},
        {"base_velocity": np.ones((9, 2, 2))},
        {"foot_contact": np.ones((9, 0))},
        {"foot_contact": np.ones((9, 1)), "foot_velocity": np.ones((9, 1, 0))},
        {"foot_velocity": np.ones((9, 2))},
    ],
)
def test_tables_of_another_shape_are_refused(tmp_path, capsys, change):
    """Some of them ended in a traceback, others were worked out as if they were none."""
    sound = {"time": np.arange(9.0), "joint_velocity": np.ones((9, 2)), "joint_torque": np.ones((9, 2))}
    np.savez(tmp_path / "a.npz", **(sound | change))
    assert main(["audit", str(tmp_path / "a.npz"), "--motor", library_motors()[0]]) == 2
    said = capsys.readouterr().err
    assert "is not allowed" in said and said.count("\n") == 1


def test_columns_of_feet_that_fit_no_foot_are_refused(tmp_path):
    head = "time,joint_velocity_0,joint_torque_0,foot_velocity_x"
    (tmp_path / "a.csv").write_text(f"{head}\n0,1,1,1\n1,1,1,1\n")
    with pytest.raises(SprintlabError, match="not as many for every foot"):
        load_rollout(tmp_path / "a.csv")


def test_time_may_be_that_of_the_calendar(tmp_path):
    """Seconds since 1970, as most recorders write them."""
    sound = {"joint_velocity": np.ones((9, 2)), "joint_torque": np.ones((9, 2))}
    np.savez(tmp_path / "a.npz", time=1.76e9 + 0.002 * np.arange(9.0), **sound)
    rollout = load_rollout(tmp_path / "a.npz")
    assert rollout.time[-1] - rollout.time[0] == pytest.approx(0.016, abs=1e-6)


def test_what_would_take_minutes_and_all_memory_is_refused(tmp_path):
    """Small when packed: eight million bytes would become as many numbers, and twenty arrays of them."""
    bytes_ = np.zeros((400_001, 20), "u1")
    np.savez_compressed(
        tmp_path / "a.npz", time=np.arange(400_001), joint_velocity=bytes_, joint_torque=bytes_
    )
    with pytest.raises(SprintlabError, match="8000020 numbers"):
        load_rollout(tmp_path / "a.npz")
    with pytest.raises(SprintlabError, match="8000020 numbers"):  # a log's columns come without an archive
        Rollout(time=np.arange(400_001.0), joint_velocity=bytes_, joint_torque=bytes_)


def test_the_way_of_many_short_stances_is_that_of_each():
    """Stances of one sample and of three, one cut off at either end."""
    contact = np.array([1, 0, 1, 0, 1, 1, 1, 0, 0, 1.0])[:, None]
    rollout = Rollout(
        time=np.arange(10.0),
        joint_velocity=np.ones((10, 1)),
        joint_torque=np.ones((10, 1)),
        foot_contact=contact,
        foot_velocity=np.arange(10.0)[:, None, None] * np.array([1.0, 0.0]),
    )
    verdict = audit_rollout(rollout, MOTOR, GEAR, BUS)
    assert (verdict.slip, verdict.stance) == pytest.approx(((2 + 4 + 5 + 6) / 2, 2.0))


def test_a_picture_of_more_joints_than_anybody_looks_at_is_refused():
    """Two samples of 200 joints, a file of a kilobyte, were drawn for half a minute."""
    velocity = np.zeros((2, 200))
    many = Rollout(time=np.array([0.0, 1.0]), joint_velocity=velocity, joint_torque=velocity)
    with pytest.raises(InvalidValueError, match="joints of a figure = 200 is not allowed"):
        rollout_figure(many, MOTOR, GEAR, BUS)
