"""Train mjlab's own Go1 flat task under the refined motor model, with adaptive commands.

    pip install 'sprintlab[mjlab]'
    python examples/mjlab_go1_refined_motor.py --environments 4096 --iterations 1000 --device cuda:0

Only two configurations of mjlab's task change: the actuators and the command. The motors are those of this
package's `go1` (`sprintlab robot show go1` prints their sources), found by the names of mjlab's joints.
"""

from __future__ import annotations

import argparse
import os
from dataclasses import asdict
from pathlib import Path

import torch
from mjlab.actuator import BuiltinPositionActuatorCfg
from mjlab.asset_zoo.robots.unitree_go1 import go1_constants as go1
from mjlab.entity import EntityArticulationInfoCfg
from mjlab.envs import ManagerBasedRlEnv, ManagerBasedRlEnvCfg
from mjlab.rl import MjlabOnPolicyRunner, RslRlVecEnvWrapper
from mjlab.tasks.velocity.config.go1.env_cfgs import unitree_go1_flat_env_cfg
from mjlab.tasks.velocity.config.go1.rl_cfg import unitree_go1_ppo_runner_cfg

from sprintlab.integrations.mjlab import AdaptiveVelocityCommandCfg, PmsmActuatorCfg
from sprintlab.motors import MOTOR_MODELS, MotorModel
from sprintlab.robots import robot_motors


def joints(stock: BuiltinPositionActuatorCfg, model: MotorModel) -> PmsmActuatorCfg:
    """One group of joints with mjlab's own gains."""
    return PmsmActuatorCfg(
        target_names_expr=stock.target_names_expr,
        stiffness=stock.stiffness,
        damping=stock.damping,
        motors=robot_motors("go1"),
        model=model,
    )


def task(environments: int, model: MotorModel) -> ManagerBasedRlEnvCfg:
    """mjlab's Go1 flat task with our motors and our commands."""
    configuration = unitree_go1_flat_env_cfg()
    configuration.scene.num_envs = environments
    configuration.scene.entities["robot"].articulation = EntityArticulationInfoCfg(
        actuators=(
            joints(go1.GO1_HIP_ACTUATOR_CFG, model),
            joints(go1.GO1_KNEE_ACTUATOR_CFG, model),
        ),
        soft_joint_pos_limit_factor=0.9,
    )
    configuration.commands["twist"] = AdaptiveVelocityCommandCfg(upper=1.0, top=4.0, growth=0.05)
    configuration.curriculum.pop("command_vel", None)  # the command's range grows by itself
    return configuration


def train(environments: int, iterations: int, model: MotorModel, device: str, folder: Path) -> None:
    """Train and leave ``model_*.pt`` and a TensorBoard log in ``folder``."""
    settings = unitree_go1_ppo_runner_cfg()
    settings.logger = "tensorboard"
    environment = ManagerBasedRlEnv(cfg=task(environments, model), device=device)
    runner = MjlabOnPolicyRunner(RslRlVecEnvWrapper(environment), asdict(settings), str(folder), device)
    try:
        runner.learn(num_learning_iterations=iterations, init_at_random_ep_len=True)
    finally:
        environment.close()


def main() -> None:
    """Read the command line and train."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--environments", type=int, default=4096)
    parser.add_argument("--iterations", type=int, default=1000)
    parser.add_argument("--model", choices=MOTOR_MODELS, default="refined")
    parser.add_argument("--device", default="cuda:0" if torch.cuda.is_available() else "cpu")
    parser.add_argument("--folder", type=Path, default=Path("runs/mjlab-go1"))
    chosen = parser.parse_args()
    train(chosen.environments, chosen.iterations, chosen.model, chosen.device, chosen.folder)


if __name__ == "__main__":
    os.environ.setdefault("MUJOCO_GL", "disabled")
    main()
