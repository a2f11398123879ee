"""Powers and forces count every motor step, not only those that are sampled."""

import numpy as np
import pytest

from sprintlab.evaluation.motor_steps import MotorSteps
from sprintlab.motors import DriveOutput, copper_loss, saturate
from sprintlab.plant import Plant, PlantOptions, TrialSettings


@pytest.fixture
def plant(robot):
    plant = Plant(robot, PlantOptions(), TrialSettings())
    plant.drive_output = DriveOutput(0.0, np.zeros(12), 0.0, 0.0, 0.0)
    return plant


def run(plant, steps, action=lambda index: None):
    """Motor steps of a plant that stands still, but for what ``action`` changes before each; two a sample."""
    watched = MotorSteps(plant, steps)
    for index in range(steps):
        if index % 2 == 0:
            watched.mark_sample()
        action(index)
        for _ in range(plant.options.substeps):
            watched.watch_step(plant.data)
    watched.mark_sample()
    return watched.between_samples()


def test_power_is_the_mean_of_torque_times_way(plant, robot):
    """Torque and speed in every second motor step only: that is half of the power, whenever it is sampled."""
    joints = [plant.model.joint(name).qposadr[0] for name in robot.joint_names]

    def act(index):
        working = index % 2
        plant.data.ctrl[:] = 3.0 * working
        plant.drive_output = plant.drive_output._replace(motor_torque=np.full(12, 0.4 * working))
        plant.data.qpos[joints] += 0.002 * working  # 2 rad/s

    found = run(plant, 10, act)
    shaft = saturate(robot.motors, np.full(12, 0.4)) * 2.0 * robot.gear.ratio
    loss = copper_loss(robot.motors, np.full(12, 0.4))
    np.testing.assert_allclose(found["joint_power"][1:], 3.0)
    np.testing.assert_allclose(found["copper_loss"][1:], np.tile(0.5 * loss, (5, 1)))
    np.testing.assert_allclose(found["bus_power"][1:], 0.5 * (shaft + loss).sum())


@pytest.mark.parametrize(("steps", "share"), [(1, 0.2), (2, 0.4), (3, 0.6), (5, 1.0), (9, 1.0)])
def test_the_greatest_foot_force_is_a_mean_over_five_milliseconds(plant, steps, share):
    def act(index):
        plant.pads.normal_force = [0.0, 1000.0 * (7 <= index < 7 + steps), 0.0, 0.0]

    assert run(plant, 30, act)["foot_impact"].max() == pytest.approx(1000.0 * share)
