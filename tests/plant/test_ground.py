"""The ground under the plant: slopes turn gravity, rough ground is a heightfield with the floor's contact."""

import math

import mujoco
import numpy as np
import pytest

from sprintlab.evaluation.recorder import Recorder
from sprintlab.plant import Ground, Plant, PlantOptions, RoughGround, TrialSettings

ROUGH = Ground(roughness=0.02, seed=3)


def standing(robot, ground, seconds, *, place=0.0):
    """A plant that has stood in its default pose on a ground, and the recorder that watched."""
    plant = Plant(robot, PlantOptions(ground=ground), TrialSettings())
    plant.data.qpos[0] = place
    plant.data.qpos[2] += ground.roughness if place else 0.0
    recorder = Recorder(plant, 1000)
    assert plant.advance(robot.default_pose, round(1000 * seconds), recorder)
    return plant, recorder.trajectory()


@pytest.mark.parametrize("slope", [0.05, -0.3])
def test_the_inertial_unit_feels_the_true_vertical(robot, slope):
    plant = Plant(robot, PlantOptions(ground=Ground(slope=slope)), TrialSettings())
    angle = math.atan(slope)
    felt = plant.measurement().projected_gravity
    np.testing.assert_allclose(felt, [-math.sin(angle), 0.0, -math.cos(angle)], atol=1e-12)
    assert np.linalg.norm(plant.model.opt.gravity) == pytest.approx(9.81)


@pytest.mark.parametrize("slope", [0.3, -0.3])
def test_a_robot_in_the_air_falls_along_the_true_vertical(robot, slope):
    plant = Plant(robot, PlantOptions(ground=Ground(slope=slope), drag_area=0.0), TrialSettings())
    plant.data.qpos[2] += 1.0
    assert plant.advance(robot.default_pose, 200, Recorder(plant, 1000))
    mujoco.mj_subtreeVel(plant.model, plant.data)
    down = 0.2 * 9.81 / math.hypot(1.0, slope) * np.array([-slope, 0.0, -1.0])
    np.testing.assert_allclose(plant.data.subtree_linvel[0], down, atol=0.005)


def test_the_height_is_that_of_the_simulated_field(robot):
    plant = Plant(robot, PlantOptions(ground=ROUGH), TrialSettings())
    assert plant.rough is not None
    floor, random = plant.model.geom("floor").id, np.random.default_rng(0)
    mujoco.mj_kinematics(plant.model, plant.data)
    for x, y in random.uniform((-3.9, -7.9), (251.9, 7.9), (200, 2)):
        start, down = np.array([x, y, 1.0]), np.array([0.0, 0.0, -1.0])
        height = 1.0 - mujoco.mj_rayHfield(plant.model, plant.data, floor, start, down, None)
        assert plant.rough.plane(x, y)[0] == pytest.approx(height, abs=1e-7)


def test_the_normal_is_that_of_the_heights_around_a_place():
    field, step = RoughGround(ROUGH), 1e-6
    for x, y in np.random.default_rng(0).uniform((3.0, -7.0), (200.0, 7.0), (50, 2)):
        height, (nx, ny, nz) = field.plane(x, y)
        east = (field.plane(x + step, y)[0] - height) / step
        north = (field.plane(x, y + step)[0] - height) / step
        np.testing.assert_allclose((-nx / nz, -ny / nz), (east, north), atol=1e-6)
        assert math.hypot(nx, ny, nz) == pytest.approx(1.0)


def test_on_its_flat_start_a_rough_ground_is_the_floor(robot):
    rough, rough_run = standing(robot, ROUGH, 0.3)
    level, level_run = standing(robot, Ground(), 0.3)
    np.testing.assert_allclose(rough.data.qpos, level.data.qpos, atol=1e-7)
    np.testing.assert_allclose(rough_run.foot_penetration, level_run.foot_penetration, atol=1e-7)
    assert rough_run.foot_penetration is not None and rough_run.foot_penetration[-1].min() > 0.0


def test_a_robot_on_rough_ground_weighs_what_it_weighs(robot):
    plant, trajectory = standing(robot, ROUGH, 1.0, place=20.0)
    weight = float(plant.model.body_mass.sum()) * 9.81
    assert trajectory.foot_force[-50:].sum(axis=1).mean() == pytest.approx(weight, rel=0.02)
    assert plant.data.qpos[2] != pytest.approx(robot.standing_height, abs=1e-4)
    assert trajectory.foot_penetration[-1].max() < 0.004


def test_who_runs_off_the_field_has_fallen(robot):
    plant = Plant(robot, PlantOptions(ground=ROUGH), TrialSettings())
    plant.data.qpos[1] = 7.5
    assert not plant.advance(robot.default_pose, 1, Recorder(plant, 5))
    assert plant.fall_reason == "left the rough ground"
