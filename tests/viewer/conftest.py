"""A recorded run of two seconds."""

import numpy as np
import pytest

from sprintlab.control import load_policy, shipped_policy
from sprintlab.evaluation.results import TrialSettings
from sprintlab.evaluation.trial import TrialRequest, run_trial


@pytest.fixture(scope="session")
def policy():
    return load_policy(shipped_policy())


@pytest.fixture(scope="session")
def recorded(policy, robot):
    """Arrays of a run to 2 m/s, held for half a second."""
    request = TrialRequest(top_speed=2.0, hold=0.5, settings=TrialSettings(), keep_trajectory=True)
    trajectory = run_trial(policy, robot, request).trajectory
    assert trajectory is not None
    return trajectory.arrays()


@pytest.fixture(scope="session")
def trajectory_file(recorded, tmp_path_factory):
    path = tmp_path_factory.mktemp("race") / "trajectory.npz"
    np.savez_compressed(path, **recorded)
    return path
