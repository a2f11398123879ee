"""The recorder of the mjlab example writes what `sprintlab audit` reads."""

import numpy as np
import pytest

from sprintlab.evaluation.rollout_audit import audit_rollout
from sprintlab.evaluation.rollouts import load_rollout
from sprintlab.robots import robot_motors

JOINTS = 12


@pytest.mark.slow
def test_mjlab_in_mjlab(tmp_path, load_script):
    torch = pytest.importorskip("torch")
    pytest.importorskip("mjlab", reason="needs mjlab: pip install 'sprintlab[mjlab]'")
    from mjlab.envs import ManagerBasedRlEnv
    from mjlab.tasks.velocity.config.go1.env_cfgs import unitree_go1_flat_env_cfg

    configuration = unitree_go1_flat_env_cfg()
    configuration.scene.num_envs = 1
    env = ManagerBasedRlEnv(configuration, device="cpu")
    generator = torch.Generator().manual_seed(0)
    record = load_script("examples/rollouts/mjlab.py").record
    record(env, lambda _: torch.randn(1, JOINTS, generator=generator), 10, tmp_path / "run.npz")
    env.close()
    rollout = load_rollout(tmp_path / "run.npz")
    assert rollout.joint_velocity.shape == (10, JOINTS) and np.abs(rollout.joint_torque).max() > 0.0
    assert len(set(rollout.names)) == JOINTS
    assert 0.0 <= audit_rollout(rollout, robot_motors("go1")).impossible <= 1.0
