"""Record a MuJoCo Playground policy for `sprintlab audit`: record(env, policy, steps=500)."""

import jax
import numpy as np


def record(env, policy, steps, path="rollout.npz", seed=0):
    """Step a Playground `MjxEnv` of a legged robot; `policy` maps its observation to an action."""
    state, rows = jax.jit(env.reset)(jax.random.PRNGKey(seed)), []
    step = jax.jit(env.step)
    for _ in range(steps):
        state = step(state, policy(state.obs))
        data = state.data  # the first six velocities are the floating base's, its linear ones in the world
        parts = (data.qvel[6:], data.qfrc_actuator[6:], data.xmat[1].T @ data.qvel[:3])
        rows.append([np.asarray(part) for part in parts])
    velocity, torque, base = (np.array(column) for column in zip(*rows, strict=True))
    time = np.arange(1, steps + 1) * env.dt
    names = np.array([env.mj_model.joint(at).name for at in range(1, env.mj_model.njnt)])
    moved = {"joint_velocity": velocity, "joint_torque": torque, "base_velocity": base}
    np.savez(path, time=time, joint_names=names, **moved)
