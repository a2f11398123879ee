"""Train a sprint policy for the Unitree Go1: two sittings of PPO on one GPU, four minutes each by default.

As for BP2, the first sitting finds a gait with flight, the second spends most commands near the top of the
range. Lengths, masses and speeds are the Go1's.

    python recipes/go1_sprint.py --output runs/go1-sprint
    sprintlab export runs/go1-sprint/second/checkpoint.pt runs/go1-sprint/go1-sprint.onnx
    sprintlab race runs/go1-sprint/go1-sprint.onnx --robot go1 --top-speed 5
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from sprintlab.cli.train import require_training, run_script
from sprintlab.commands import AdaptiveSchedule, TargetSampling
from sprintlab.training.settings import TrainingSettings


def first_settings() -> TrainingSettings:
    """From nothing, with BP2's lengths scaled by leg length and its masses by mass."""
    base = TrainingSettings(robot="go1")
    return replace(
        base,
        rewards=replace(
            base.rewards, foot_clearance_target=0.08, touchdown_height=0.04, leg_distance_limit=0.045
        ),
        randomization=replace(base.randomization, payload=(-0.5, 0.7), center_of_mass=0.012),
        episodes=replace(base.episodes, leg_distance_limit=0.022, knee_clearance=0.035),
        stages=replace(base.stages, first_top=4.0, second_top=9.0),
    )


def second_settings() -> TrainingSettings:
    """From the first policy, with three of four commands in the top fifth of the range."""
    targets = TargetSampling(top_share=0.75, top_fraction=0.2)
    return replace(first_settings(), schedule=AdaptiveSchedule(targets=targets), seed=1)


@dataclass(frozen=True, kw_only=True)
class Options:
    """Where to put the two runs, how long to train each, on which device, with how many robots."""

    output: Path = Path("runs/go1-sprint")
    minutes: float = 4.0
    iterations: int = 100_000
    environments: int = 8192
    device: str = "auto"


def main(options: Options) -> Path:
    """Train both sittings one after the other; returns the last checkpoint.

    Raises:
        SprintlabError: the extra is not installed, or an option or the output folder is refused.
    """
    require_training()
    from sprintlab.training.run import TrainOptions, train

    first = TrainOptions(
        output=options.output / "first",
        minutes=options.minutes,
        iterations=options.iterations,
        environments=options.environments,
        device=options.device,
        settings=first_settings(),
    )
    checkpoint = train(first)
    # Iterations count through: the second sitting goes on where the first one stopped.
    second = replace(
        first,
        output=options.output / "second",
        iterations=2 * options.iterations,
        settings=second_settings(),
        start_from=checkpoint,
        keep_schedule=True,
        seed=1,
    )
    return train(second)


if __name__ == "__main__":
    run_script(main, Options)
