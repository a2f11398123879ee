"""The recorders of other frameworks write what `sprintlab audit` reads.

mjlab's runs in mjlab. Isaac Lab and MuJoCo Playground are not installed here: theirs run against stubs with
the names that those frameworks document, so a renamed attribute there would not be noticed.
"""

import importlib.util
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from sprintlab.evaluation.rollout_audit import audit_rollout
from sprintlab.evaluation.rollouts import load_rollout
from sprintlab.robots import robot_motors

FOLDER = Path(__file__).parents[2] / "examples" / "rollouts"
JOINTS = 12
UNITREE = [f"{leg}_{joint}_joint" for leg in ("FL", "FR", "RL", "RR") for joint in ("hip", "thigh", "calf")]


def recorder(name):
    spec = importlib.util.spec_from_file_location(f"record_{name}", FOLDER / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.record


def judged(path):
    rollout = load_rollout(path)
    return rollout, audit_rollout(rollout, robot_motors("go1"))


def test_isaac_lab_against_a_stub(tmp_path):
    rows = np.random.default_rng(0).normal(size=(2, 1, JOINTS))
    data = SimpleNamespace(
        joint_vel=rows[0],
        applied_torque=rows[1],
        root_lin_vel_b=np.ones((1, 3)),
        joint_names=sorted(UNITREE, key=lambda name: name.split("_")[1]),  # type by type, as Isaac Lab
    )
    env = SimpleNamespace(scene={"robot": SimpleNamespace(data=data)}, step_dt=0.02)
    env.unwrapped, env.reset, env.step = env, lambda: ("first", {}), lambda action: (action, 0, 0, 0, {})
    recorder("isaac_lab")(env, lambda observation: observation, 5, tmp_path / "run.npz")
    rollout, _ = judged(tmp_path / "run.npz")
    assert rollout.names[:4] == ("FL_calf_joint", "FR_calf_joint", "RL_calf_joint", "RR_calf_joint")
    assert np.array_equal(rollout.joint_torque, np.repeat(rows[1], 5, axis=0))
    assert rollout.time == pytest.approx(0.02 * np.arange(1, 6))


def test_mujoco_playground_against_a_stub(tmp_path, monkeypatch):
    jax = SimpleNamespace(jit=lambda function: function, random=SimpleNamespace(PRNGKey=lambda seed: seed))
    monkeypatch.setitem(sys.modules, "jax", jax)
    values = np.arange(18.0)
    state = SimpleNamespace(obs=0, data=SimpleNamespace(qvel=values, qfrc_actuator=2.0 * values))
    joints = [SimpleNamespace(name=name) for name in ["freejoint", *UNITREE]]
    model = SimpleNamespace(joint=joints.__getitem__, njnt=len(joints))
    env = SimpleNamespace(reset=lambda key: state, step=lambda state, action: state, dt=0.02, mj_model=model)
    recorder("mujoco_playground")(env, lambda observation: observation, 4, tmp_path / "run.npz")
    rollout, _ = judged(tmp_path / "run.npz")
    assert np.array_equal(rollout.joint_velocity[0], values[6:])
    assert np.array_equal(rollout.joint_torque[0], 2.0 * values[6:])
    assert np.array_equal(rollout.base_velocity[0], values[:3])


@pytest.mark.slow
def test_mjlab_in_mjlab(tmp_path):
    torch = pytest.importorskip("torch")
    pytest.importorskip("mjlab", reason="needs mjlab: pip install 'sprintlab[mjlab]'")
    from mjlab.envs import ManagerBasedRlEnv
    from mjlab.tasks.velocity.config.go1.env_cfgs import unitree_go1_flat_env_cfg

    configuration = unitree_go1_flat_env_cfg()
    configuration.scene.num_envs = 1
    env = ManagerBasedRlEnv(configuration, device="cpu")
    generator = torch.Generator().manual_seed(0)
    recorder("mjlab")(env, lambda _: torch.randn(1, JOINTS, generator=generator), 10, tmp_path / "run.npz")
    rollout, verdict = judged(tmp_path / "run.npz")
    env.close()
    assert rollout.joint_velocity.shape == (10, JOINTS) and np.abs(rollout.joint_torque).max() > 0.0
    assert len(set(rollout.names)) == JOINTS
    assert 0.0 <= verdict.impossible <= 1.0
