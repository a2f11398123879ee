"""PPO from rsl_rl, built from our settings."""

from __future__ import annotations

from contextlib import redirect_stdout
from io import StringIO
from typing import Any

from rsl_rl.algorithms import PPO

from sprintlab.training.environment import SprintEnvironment
from sprintlab.training.settings import PpoSettings

LARGEST_STD = 1.5


def algorithm_configuration(settings: PpoSettings) -> dict[str, Any]:
    """The nested dictionary that ``PPO.construct_algorithm`` reads."""
    network = {"class_name": "MLPModel", "hidden_dims": list(settings.hidden), "activation": "elu"}
    noise = {
        "class_name": "GaussianDistribution",
        "init_std": settings.initial_std,
        "std_type": "scalar",
        "std_range": (settings.least_std, LARGEST_STD),
    }
    return {
        "num_steps_per_env": settings.steps,
        "obs_groups": {"actor": ["actor"], "critic": ["critic"]},
        "multi_gpu": None,
        "torch_compile_mode": None,
        "actor": {**network, "obs_normalization": True, "distribution_cfg": noise},
        "critic": {**network, "obs_normalization": True},
        "algorithm": {
            "class_name": "PPO",
            "num_learning_epochs": settings.epochs,
            "num_mini_batches": settings.mini_batches,
            "learning_rate": settings.learning_rate,
            "schedule": "adaptive",
            "desired_kl": settings.desired_kl,
            "gamma": settings.discount,
            "lam": settings.gae,
            "clip_param": settings.clip,
            "entropy_coef": settings.entropy,
            "max_grad_norm": 1.0,
            "value_loss_coef": 1.0,
            "use_clipped_value_loss": True,
            "rnd_cfg": None,
            "symmetry_cfg": None,
        },
    }


def build_learner(environment: SprintEnvironment, settings: PpoSettings) -> PPO:
    """Actor, critic, storage and optimizer for an environment."""
    configuration = algorithm_configuration(settings)
    with redirect_stdout(StringIO()):  # rsl_rl prints the networks
        learner = PPO.construct_algorithm(
            environment.get_observations(), environment, configuration, str(environment.device)
        )
    learner.train_mode()
    return learner
