"""Reading the cloud of a training: what it says, and what is refused."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from studies.paper.training_cloud import TrainingCloud, load_training_cloud

from sprintlab.core.errors import SprintlabError
from sprintlab.motors import joint_torque, saturate, torque_limits


def save(path, arrays):
    np.savez(path, **arrays)
    return path


def test_a_cloud_is_read_as_it_was_written(cloud_arrays, tmp_path):
    cloud = load_training_cloud(save(tmp_path / "cloud.npz", cloud_arrays))
    assert cloud.motor_model == "square" and cloud.robot == "bp2"
    assert cloud.on_limit.dtype == bool
    for name in ("joint_velocity", "joint_torque", "forward_speed", "motor_strength"):
        assert getattr(cloud, name) == pytest.approx(np.asarray(cloud_arrays[name], dtype=float))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"format": np.array(2)}, "format 2"),
        ({"joint_torque": None}, "joint_torque"),
        ({"joint_torque": np.zeros((3, 4, 11))}, "joint_torque has shape"),
        ({"joint_velocity": np.zeros((3, 12))}, "joint_velocity has shape"),
        ({"motor_strength": np.ones(4)}, "motor_strength has shape"),
        ({"forward_speed": np.full((3, 4), np.nan)}, "forward_speed must be finite"),
        ({"robot": None}, "no cloud of a training"),
        ({"time": np.array(["a", "b", "c"])}, "no cloud of a training"),
        ({"motor_model": np.array("$x^{$")}, "of one of the motors"),
        ({"motor_strength": np.zeros((4, 12))}, "motor_strength is beyond"),
        ({"joint_torque": np.full((3, 4, 12), 1e13)}, "joint_torque is beyond"),
        ({"joint_velocity": np.zeros((3, 30_000, 12))}, "larger than a cloud"),
    ],
)
def test_a_damaged_cloud_is_refused(cloud_arrays, tmp_path, change, words):
    changed = {name: value for name, value in (cloud_arrays | change).items() if value is not None}
    with pytest.raises(SprintlabError, match=words):
        load_training_cloud(save(tmp_path / "cloud.npz", changed))


def test_a_cloud_of_too_many_numbers_is_refused_before_they_are_unpacked(cloud_arrays, tmp_path):
    """Packed, 500 kB of them took 1.2 GB."""
    many = np.zeros(9_000_000, dtype=np.float32)
    np.savez_compressed(tmp_path / "cloud.npz", **{**cloud_arrays, "time": many})
    with pytest.raises(SprintlabError, match="unpacks to more than 32 MB"):
        load_training_cloud(tmp_path / "cloud.npz")


def test_a_cloud_of_a_robot_with_fewer_joints_is_refused(cloud_arrays, tmp_path):
    fewer = {name: array[..., :4] for name, array in cloud_arrays.items() if array.shape[-1:] == (12,)}
    with pytest.raises(SprintlabError, match="joint_velocity has shape"):
        load_training_cloud(save(tmp_path / "cloud.npz", cloud_arrays | fewer))


def test_what_is_no_archive_is_refused(cloud_arrays, tmp_path):
    with pytest.raises(SprintlabError, match="cannot read"):
        load_training_cloud(tmp_path / "none.npz")
    path: Path = save(tmp_path / "cloud.npz", cloud_arrays)
    whole = path.read_bytes()
    for part in (b"", b"no archive", whole[: len(whole) // 2]):
        path.write_bytes(part)
        with pytest.raises(SprintlabError, match="no cloud of a training"):
            load_training_cloud(path)


@settings(max_examples=40, deadline=None)
@given(
    bus=st.floats(0.7, 1.0),
    strength=st.floats(0.8, 1.2),
    share=st.floats(-1.3, 1.3),
    speed=st.floats(-30.0, 30.0),
)
def test_the_limit_is_that_of_the_robots_own_bus_and_strength(robot, bus, strength, share, speed):
    ratio = np.asarray(robot.gear.ratio)
    lower, upper = torque_limits(robot.motors, speed * ratio, bus * robot.bus_voltage)
    peak = np.asarray(robot.motors.peak_torque)
    wanted = np.clip(share * np.where(share > 0, upper, -lower), -peak, peak)
    cloud = TrainingCloud(
        robot="bp2",
        motor_model="square",
        time=np.zeros(1),
        joint_velocity=np.full((1, 1, 12), speed),
        joint_torque=(joint_torque(robot.gear, saturate(robot.motors, wanted), speed) * strength)[None, None],
        on_limit=np.zeros((1, 1, 12), dtype=bool),
        forward_speed=np.zeros((1, 1)),
        bus_voltage_factor=np.full((1, 1), bus),
        resistance_factor=np.ones(1),
        motor_strength=np.full((1, 12), strength),
    )
    assert cloud.motor_torque(robot)[0, 0] == pytest.approx(wanted, abs=1e-6)
    margin = 5e-3 * peak
    clearly = (wanted > upper + 1.01 * margin) | (wanted < lower - 1.01 * margin)
    hardly = (wanted > upper + 0.99 * margin) | (wanted < lower - 0.99 * margin)
    found = cloud.impossible(robot)[0, 0]
    assert (found | ~clearly).all() and (hardly | ~found).all()
