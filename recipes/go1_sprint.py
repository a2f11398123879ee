"""Train the shipped Go1 policy: BP2's recipe at the Go1's size.

    python recipes/go1_sprint.py --output runs/go1-sprint
    sprintlab race runs/go1-sprint/policy.onnx

Lengths are scaled by leg length, masses by mass, speeds by the Froude number; all else is as BP2's
defaults were that day: without a reward for the speed itself, quiet robots and commands to brake.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from sprintlab.api.training import ScriptOptions, run_script, train_settings
from sprintlab.commands import AdaptiveSchedule
from sprintlab.training.settings import TrainingSettings

DEFAULTS = ScriptOptions(output=Path("runs/go1-sprint"), iterations=2200, minutes=60.0)


def go1_settings() -> TrainingSettings:
    """From nothing, with BP2's lengths scaled by leg length and its masses by mass."""
    base = TrainingSettings(robot="go1")
    return replace(
        base,
        rewards=replace(
            base.rewards,
            progress=0.0,
            foot_clearance_target=0.08,
            touchdown_height=0.04,
            leg_distance_limit=0.045,
        ),
        randomization=replace(base.randomization, payload=(-0.5, 0.7), center_of_mass=0.012),
        episodes=replace(base.episodes, leg_distance_limit=0.022, knee_clearance=0.035),
        stages=replace(base.stages, first_top=4.0, second_top=9.0, steady_iteration=None),
        schedule=AdaptiveSchedule(braking_window=1.0),
        ppo=replace(base.ppo, precision="bfloat16", quiet_share=0.0),
    )


def main(options: ScriptOptions) -> Path:
    """Train; returns the checkpoint.

    Raises:
        SprintlabError: the extra is not installed, or an option or the output folder is refused.
    """
    return train_settings(go1_settings(), keep_schedule=True, **vars(options))


if __name__ == "__main__":
    run_script(main, DEFAULTS)
