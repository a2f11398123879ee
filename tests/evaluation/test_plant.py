"""The plant: contact, falls, sensors, frames."""

import mujoco
import numpy as np
import pytest

from sprintlab.core.errors import SimulationError
from sprintlab.evaluation.recorder import Recorder
from sprintlab.motors import drive_torque
from sprintlab.plant import Plant, PlantOptions, TrialSettings


@pytest.fixture
def make_plant(robot):
    def build(settings=None, **options):
        plant = Plant(robot, PlantOptions(**options), settings or TrialSettings())
        return plant, Recorder(plant, 5000)

    return build


def test_stands_on_four_feet(make_plant, robot):
    plant, recorder = make_plant(TrialSettings(joint_noise=0.05, seed=3))
    assert plant.advance(robot.default_pose, 1500, recorder)
    trajectory = recorder.trajectory()
    assert trajectory.foot_contact[-1].all()
    assert trajectory.foot_slip_speed[-1].max() < 1e-3
    assert abs(trajectory.qpos[-1, 2] - robot.standing_height) < 0.05
    assert (trajectory.leg_distance > 0.1).all()


def test_the_recorded_torque_is_what_the_motor_law_gives(make_plant, robot):
    plant, recorder = make_plant()
    plant.advance(robot.default_pose + 0.8, 300, recorder)
    sample = recorder.trajectory()
    wanted = robot.stiffness * (sample.joint_target - sample.joint_position)
    wanted = wanted - robot.damping * sample.joint_velocity
    drive = drive_torque(robot.motors, robot.gear, wanted, sample.joint_velocity, robot.bus_voltage)
    np.testing.assert_allclose(sample.joint_torque, drive.torque, atol=1e-9)
    np.testing.assert_allclose(sample.torque_upper, drive.upper, atol=1e-9)
    assert (sample.motor_torque >= sample.torque_upper).any()


def test_leg_distance_agrees_with_mujoco(make_plant, robot):
    plant, recorder = make_plant()
    plant.data.qpos[2] += 1.0
    plant.data.qpos[plant._joint_position] += np.random.default_rng(1).uniform(-0.5, 0.5, 12)
    mujoco.mj_forward(plant.model, plant.data)
    geoms = {
        leg: [plant.model.geom(f"{leg}_{part}").id for part in ("thigh", "shank", "foot")]
        for leg in robot.leg_names
    }
    smallest = min(
        mujoco.mj_geomDistance(plant.model, plant.data, one, other, 5.0, None)
        for first in robot.leg_names
        for second in robot.leg_names
        if first < second
        for one in geoms[first]
        for other in geoms[second]
    )
    plant.advance(robot.default_pose, 1, recorder)
    assert recorder.trajectory().leg_distance[0] == pytest.approx(smallest, abs=1e-6)


def test_velocity_is_in_the_heading_frame_and_rates_in_the_body_frame(make_plant, robot):
    plant, recorder = make_plant()
    plant.data.qpos[2] += 1.0
    plant.data.qpos[3:7] = np.cos(np.pi / 4), 0.0, 0.0, np.sin(np.pi / 4)  # looks along +y
    plant.data.qvel[:6] = 0.5, 2.0, 0.0, 0.1, 0.2, 0.3
    plant.advance(robot.default_pose, 1, recorder)
    sample = recorder.trajectory()
    np.testing.assert_allclose(sample.velocity[0], [2.0, -0.5], atol=1e-12)
    np.testing.assert_allclose(sample.heading[0], np.pi / 2)
    np.testing.assert_allclose(sample.angular_velocity[0], [0.1, 0.2, 0.3])


def test_a_tilt_beyond_sixty_degrees_is_a_fall(make_plant, robot):
    for degrees, upright in ((58, True), (62, False)):
        plant, recorder = make_plant()
        half = np.radians(degrees) / 2
        plant.data.qpos[2] += 2.0
        plant.data.qpos[3:7] = np.cos(half), np.sin(half), 0.0, 0.0
        assert plant.advance(robot.default_pose, 1, recorder) is upright
        assert plant.fall_reason == ("" if upright else "tilt")


@pytest.mark.parametrize(
    ("height", "fold", "reason"), [(0.05, False, "trunk contact"), (0.3, True, "knee contact")]
)
def test_trunk_and_knee_on_the_ground_are_falls(make_plant, robot, height, fold, reason):
    plant, recorder = make_plant()
    plant.data.qpos[2] = height
    pose = np.tile([0.0, 0.3, -2.0], 4) if fold else np.tile([0.0, 2.6, -1.5], 4)
    plant.data.qpos[plant._joint_position] = pose
    mujoco.mj_kinematics(plant.model, plant.data)
    if fold:
        knee = min(plant.data.body(f"{leg}_knee").xpos[2] for leg in robot.leg_names)
        plant.data.qpos[2] -= knee - 0.5 * robot.mechanics.thigh_radius
    assert not plant.advance(pose, 20, recorder)
    assert plant.fall_reason == reason


def test_end_stops_push_back(make_plant, robot):
    plant, recorder = make_plant()
    plant.data.qpos[2] += 1.0
    upper = robot.position_limits[:, 1]
    plant.data.qpos[plant._joint_position[2]] = upper[2] - 0.1 * robot.soft_stop.zone
    plant.advance(robot.default_pose, 1, recorder)
    applied = plant.data.qfrc_applied[plant._joint_velocity]
    assert applied[2] < 0.0 and np.count_nonzero(applied) == 1


def test_trial_settings_change_friction_mass_and_pose(make_plant, robot):
    plant, _ = make_plant(TrialSettings(friction=0.7, payload=1.0, joint_noise=0.05, seed=1))
    other, _ = make_plant(TrialSettings(friction=0.7, payload=1.0, joint_noise=0.05, seed=2))
    assert plant.model.geom("FL_foot").friction[0] == 0.7
    assert plant.model.body("trunk").subtreemass[0] == pytest.approx(robot.total_mass + 1.0)
    displaced = plant.measurement().joint_position - robot.default_pose
    assert 0.0 < np.abs(displaced).max() <= 0.05
    assert (other.data.qpos != plant.data.qpos).any()


def test_a_state_that_is_not_finite_is_an_error_with_its_time(make_plant, robot):
    plant, recorder = make_plant()
    plant.data.qvel[0] = np.nan
    with pytest.raises(SimulationError, match=r"no longer finite at 0\.00 s"):
        plant.measurement()
    with pytest.raises(SimulationError, match="not finite"):
        plant.advance(np.full(12, np.nan), 1, recorder)
