"""A robot with an active waist through training, export, race and report."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("torch")

from sprintlab.api.races import race
from sprintlab.api.training import export, train
from sprintlab.control import load_policy
from sprintlab.training.settings import TrainingSettings


@pytest.mark.slow
@pytest.mark.usefixtures("brief_trials")
def test_a_robot_with_a_waist_trains_exports_and_races(tmp_path) -> None:
    settings = TrainingSettings(robot="bp2-waist")
    tiny = replace(settings.ppo, steps=2, mini_batches=1, epochs=1, hidden=(16,))
    settings = replace(settings, ppo=tiny)
    trained = train(
        settings,
        output=tmp_path / "run",
        iterations=2,
        environments=4,
        device="cpu",
        fused=False,
        tensorboard=False,
    )
    export(trained.checkpoint, tmp_path / "policy.onnx")
    policy = load_policy(tmp_path / "policy.onnx")
    assert policy.contract.joint_names[-1] == "waist" and len(policy.contract.joint_names) == 13
    assert policy.decide(np.zeros((1, 10 * 48), dtype=np.float32)).action.shape == (1, 13)

    policy = tmp_path / "policy.onnx"
    result = race(policy, top_speed=0.5, distance=0.05, trials=1, workers=1)
    assert result.robot.name == "bp2-waist"
    assert len(result.plot("torque_speed").axes) == 16 and len(result.plot("power").axes) == 2
