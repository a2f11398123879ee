"""Train the shipped BP2 policy: two sittings of PPO on one GPU, 8.3 and 8.4 minutes on an H200.

The first finds the gait under the paper's rewards plus a term against grounded running; the second starts
from it, spends most commands near the top of the range and relaxes the penalties that grow with the swing
speed.

    python recipes/bp2_sprint.py --output runs/bp2-sprint
    sprintlab export runs/bp2-sprint/second/checkpoint.pt runs/bp2-sprint/sprint.onnx
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import tyro

from sprintlab.commands import AdaptiveSchedule, TargetSampling
from sprintlab.training.methods import method_settings
from sprintlab.training.run import TrainOptions, train
from sprintlab.training.settings import RewardWeight, TrainingSettings

FIRST_MINUTES, SECOND_MINUTES = 8.3, 8.4


def first_settings() -> TrainingSettings:
    """From nothing: against the grounded run, more exploration, more fast starts than by default."""
    base = TrainingSettings()
    return replace(
        base,
        rewards=replace(base.rewards, grounded=RewardWeight(first=-0.03, second=-0.06)),
        episodes=replace(base.episodes, fast_start_share=0.25),
        ppo=replace(base.ppo, least_std=0.3, initial_std=0.8),
    )


def second_settings() -> TrainingSettings:
    """From the first policy: top of the range, softer touchdown, less weight on fast joints."""
    first = first_settings()
    rewards = replace(
        first.rewards,
        joint_acceleration=RewardWeight(first=-2.5e-7, second=-3e-8),
        action_rate=RewardWeight(first=-0.01, second=-0.005),
        smoothness=RewardWeight(first=-0.005, second=-0.0025),
        touchdown=RewardWeight(first=0.0, second=-0.03),
    )
    targets = TargetSampling(top_share=0.75, top_fraction=0.2)
    return replace(first, rewards=rewards, schedule=AdaptiveSchedule(targets=targets), seed=1)


@dataclass(frozen=True, kw_only=True)
class Options:
    """Where to put the two runs, and on which device to train."""

    output: Path = Path("runs/bp2-sprint")
    device: str = "auto"


def main(options: Options) -> Path:
    """Train both sittings one after the other; returns the last checkpoint."""
    first = train(
        TrainOptions(
            output=options.output / "first",
            minutes=FIRST_MINUTES,
            device=options.device,
            settings=first_settings(),
        )
    )
    return train(
        TrainOptions(
            output=options.output / "second",
            minutes=SECOND_MINUTES,
            device=options.device,
            settings=second_settings(),
            start_from=first,
            keep_schedule=True,
            seed=1,
        )
    )


def shipped_settings() -> TrainingSettings:
    """The settings whose hash the shipped policy's contract carries."""
    settings = second_settings()
    return replace(method_settings("sprint", settings), schedule=settings.schedule)


if __name__ == "__main__":
    print(main(tyro.cli(Options)))
