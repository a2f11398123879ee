"""The plant with a robot that has no knee springs."""

import numpy as np
import pytest

from sprintlab.plant import Plant, PlantOptions, TrialSettings
from sprintlab.robots import load_robot


class Nothing:
    """A recorder that keeps nothing."""

    def sample(self, data, drive, targets):
        pass

    def watch_step(self, data):
        pass


def test_the_go1_stands_in_the_plant():
    go1 = load_robot("go1")
    plant = Plant(go1, PlantOptions(), TrialSettings())
    for _ in range(50):
        plant.advance(go1.default_pose, 20, Nothing())
    assert plant.time == pytest.approx(1.0)
    assert not plant.fall_reason
    position, velocity = plant.joint_state()
    assert np.abs(velocity).max() < 0.5
    np.testing.assert_allclose(position, go1.default_pose, atol=0.2)
    assert plant.data.body("trunk").xpos[2] > 0.9 * go1.standing_height
