import numpy as np
import pytest

from sprintlab.core.errors import InvalidValueError
from sprintlab.plant import Plant, PlantOptions, TrialSettings
from sprintlab.viewer.live import LivePlant, Session


@pytest.fixture
def session(robot, policy):
    return Session(robot, {"sprint": policy, "again": policy})


def run(session, seconds):
    return session.advance(round(1000 * seconds))


def test_robot_runs_at_the_wanted_speed(session):
    run(session, 0.3)
    session.turn(speed=2.0)
    snapshot = run(session, 2.5)
    assert snapshot.falls == 0
    assert snapshot.speed == pytest.approx(2.0, abs=0.4)
    assert snapshot.distance > 2.0
    assert snapshot.bus_power > 100.0
    assert snapshot.joint_speed.shape == snapshot.motor_torque.shape == (1250, 12)


def test_robot_turns(session):
    session.turn(speed=1.0, yaw_rate=0.6)
    run(session, 2.5)
    assert 0.6 < session.plant.base_state().heading < 2.0


def test_fall_is_counted_and_the_robot_stands_up(session):
    session.push(left=400.0)
    fallen = run(session, 0.1)
    while not fallen.fall_reason and fallen.time < 1.5:
        fallen = run(session, 0.1)
    assert fallen.falls == 1
    assert fallen.fall_reason in ("tilt", "trunk contact", "knee contact")
    risen = run(session, 1.5)
    assert risen.fall_reason == ""
    assert risen.time == pytest.approx(fallen.time + 1.5, abs=0.01)


def test_push_changes_momentum_by_the_impulse(robot):
    plant = LivePlant(robot)
    before = plant.data.qvel[:3].copy()
    plant.push(forward=10.0, left=-5.0)
    change = (plant.data.qvel[:3] - before) * plant.model.body_mass.sum()
    np.testing.assert_allclose(change, [10.0, -5.0, 0.0], atol=1e-9)


def test_motor_model_and_voltage_reach_the_motors(session):
    session.turn(motor_model="square")
    limits = session.plant._drive.limits(np.full(12, 40.0))
    np.testing.assert_allclose(limits[1], np.broadcast_to(session.robot.motors.peak_torque, 12))
    session.turn(motor_model="refined", bus_voltage=30.0)
    assert session.plant._drive.limits(np.full(12, 20.0))[1].max() < limits[1].max()


def test_untouched_plant_is_the_evaluation_s(robot):
    live, plant = LivePlant(robot), Plant(robot, PlantOptions(), TrialSettings())
    np.testing.assert_array_equal(live.data.qpos, plant.data.qpos)
    for one, other in zip(live.measurement(), plant.measurement(), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-12)


@pytest.mark.parametrize(
    "change",
    [{"speed": 99.0}, {"motor_model": "magic"}, {"policy": "none"}, {"bus_voltage": -1.0}],
    ids=lambda change: next(iter(change)),
)  # fmt: skip
def test_knobs_outside_their_range_are_refused_and_nothing_changes(session, change):
    before = session.knobs
    with pytest.raises(InvalidValueError, match=next(iter(change))):
        session.turn(**change)
    assert session.knobs == before
