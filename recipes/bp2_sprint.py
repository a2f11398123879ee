"""Train the shipped BP2 policy: 2500 iterations, 3.6 minutes on one H200 (164 million environment steps).

    python recipes/bp2_sprint.py --output runs/bp2-sprint
    sprintlab export runs/bp2-sprint/checkpoint.pt runs/bp2-sprint/sprint.onnx

The settings are the defaults of that day: without jitter of the delay, without holding the heading, without
a reward for the speed itself, without quiet robots and commands to brake, with fewer targets at rest, and
with more memory for contacts than four feet need.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from sprintlab.cli.train import run_script, train_settings
from sprintlab.commands import AdaptiveSchedule, TargetSampling
from sprintlab.training.settings import TrainingSettings

ITERATIONS = 2500
LONGEST_MINUTES = 60.0


@dataclass(frozen=True, kw_only=True)
class Options:
    """Where to put the run, and on which device to train."""

    output: Path = Path("runs/bp2-sprint")
    device: str = "auto"
    resume: bool = False


def shipped_settings() -> TrainingSettings:
    """The settings whose hash the shipped policy's contract carries."""
    defaults = TrainingSettings()
    return replace(
        defaults,
        schedule=AdaptiveSchedule(targets=TargetSampling(zero_share=0.04), braking_window=1.0),
        heading_hold=False,
        rewards=replace(defaults.rewards, progress=0.0),
        ppo=replace(defaults.ppo, quiet_share=0.0),
        stages=replace(defaults.stages, steady_iteration=None),
        randomization=replace(defaults.randomization, delay_jitter=0.0),
        simulation=replace(defaults.simulation, max_constraints=24, max_contacts=8),
    )


def main(options: Options) -> Path:
    """Train; returns the checkpoint.

    Raises:
        SprintlabError: the extra is not installed, or an option or the output folder is refused.
    """
    return train_settings(
        shipped_settings(),
        iterations=ITERATIONS,
        minutes=LONGEST_MINUTES,
        keep_schedule=True,
        **vars(options),
    )


if __name__ == "__main__":
    run_script(main, Options)
