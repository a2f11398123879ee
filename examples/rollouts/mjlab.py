"""Record an mjlab policy for `sprintlab audit`: record(env, policy, steps=500)."""

import numpy as np


def record(env, policy, steps, path="rollout.npz", robot="robot", which=0):
    """Step an mjlab `ManagerBasedRlEnv`; `policy` maps its observations to actions."""
    entity, rows = env.unwrapped.scene[robot], []
    data, observation = entity.data, env.reset()[0]
    for _ in range(steps):
        observation = env.step(policy(observation))[0]
        parts = (data.joint_vel, data.qfrc_actuator, data.root_link_lin_vel_b)
        rows.append([part[which].tolist() for part in parts])
    velocity, torque, base = (np.array(column) for column in zip(*rows, strict=True))
    time = np.arange(1, steps + 1) * env.unwrapped.step_dt
    names = np.array(entity.joint_names)
    moved = {"joint_velocity": velocity, "joint_torque": torque, "base_velocity": base}
    np.savez(path, time=time, joint_names=names, **moved)
