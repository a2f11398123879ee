"""Settings of a training that takes a moment."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch
from torch import cuda, multiprocessing, set_num_threads

from sprintlab.training.environment.sprint import ENGINE_STATE, SprintEnvironment
from sprintlab.training.learner.algorithm import EstimatorPpo
from sprintlab.training.settings import PpoSettings, SimulationSettings, TrainingSettings


def small_settings(
    environments: int = 8,
    steps: int = 2,
    mini_batches: int = 2,
    hidden: tuple[int, ...] = (16,),
    ppo: dict[str, Any] | None = None,
    **others: Any,
) -> TrainingSettings:
    """Few robots, one pass over a short rollout, and small networks.

    Args:
        environments: robots side by side.
        steps: of a rollout.
        mini_batches: of the pass.
        hidden: widths of actor and critic.
        ppo: further settings of PPO.
        others: further settings of the training.
    """
    return TrainingSettings(
        simulation=SimulationSettings(environments=environments),
        ppo=PpoSettings(
            steps=steps, mini_batches=mini_batches, hidden=hidden, **{"epochs": 1, **(ppo or {})}
        ),
        **others,
    )


def on_two(work: Callable[[int, Path], None], folder: Path, gpus: bool = False) -> None:
    """Call ``work(rank, folder)`` in two processes that find each other as those of torchrun do.

    They are copies of this one, since to import PyTorch anew takes seconds, but where CUDA does not allow it.
    """
    set_num_threads(1)  # no pool that a fork would lose
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    method = "spawn" if cuda.is_available() else "fork"
    multiprocessing.start_processes(_joined, args=(work, folder, gpus, port), nprocs=2, start_method=method)


def _joined(rank: int, work: Callable[[int, Path], None], folder: Path, gpus: bool, port: int) -> None:
    os.environ |= {"MASTER_ADDR": "127.0.0.1", "MASTER_PORT": str(port), "WORLD_SIZE": "2"}
    os.environ |= {"RANK": str(rank), "LOCAL_RANK": str(rank)}
    if not gpus:
        os.environ["CUDA_VISIBLE_DEVICES"] = ""
    work(rank, folder)


def tensors(environment: SprintEnvironment) -> dict[str, torch.Tensor]:
    """Everything that a step reads and changes, by name: the tensors themselves."""
    own = (
        "action", "previous_action", "earlier_action", "last_joint_velocity", "running_speed",
        "running_yaw_rate", "running_side_speed", "running_command", "course",
        "filtered", "estimate", "held", "history",
        "grid_weights", "tracked",
        "episode_length_buf", "episode_limit", "lower", "upper", "stage", "weights", "reward",
        "time_out", "done", "ended_share", "chances", "record", "handedness",
        "actor_observation", "critic_observation", "slope", "mean_delay",
    )  # fmt: skip
    named = {name: getattr(environment, name) for name in own}
    named |= {f"commands.{name}": value for name, value in environment.commands._asdict().items()}
    engine = (
        "qpos", "qvel", "target", "previous_target", "delay", "stiffness", "damping", "strength",
        "parameters", "torque",
        "leg_distance", "foot_position", "foot_velocity", "knee_position", *ENGINE_STATE,
    )  # fmt: skip
    return named | {f"engine.{name}": getattr(environment.engine, name) for name in engine}


def copy_tensors(state: dict[str, torch.Tensor], environment: SprintEnvironment) -> None:
    """Copy saved ``tensors`` into those that the graphs know."""
    for name, tensor in tensors(environment).items():
        tensor.copy_(state[name])


def networks(learner: EstimatorPpo) -> dict[str, torch.Tensor]:
    """Parameters and buffers of both networks, by name."""
    both = {"actor": learner.actor, "critic": learner.critic}
    return {f"{key}.{name}": each for key, part in both.items() for name, each in part.state_dict().items()}
