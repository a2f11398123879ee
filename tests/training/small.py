"""Settings of a training that takes a moment."""

from __future__ import annotations

from typing import Any

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
