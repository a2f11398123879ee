"""Train the shipped policy ``sprint``: two trainings and the mean of their weights.

    python recipes/sprint.py --output runs/sprint
    sprintlab race runs/sprint/policy.onnx

The first training begins from nothing. The second goes on from it with targets that stay long enough for a
robot to reach its top speed, which takes ten seconds. Where each has its weaknesses, their mean has neither:
it passes the audit over 22 runs, and its ends do not. About six minutes of one H200 where three trainings
share it.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from sprintlab.api.training import ScriptOptions, run_script, train_settings
from sprintlab.training.methods import method_settings
from sprintlab.training.settings import RewardWeight, TrainingSettings

DEFAULTS = ScriptOptions(output=Path("runs/sprint"), iterations=3700, minutes=60.0)
FIRST_SHARE = 20 / 37
"""Of the iterations, those of the first training."""


def first_settings() -> TrainingSettings:
    """From nothing: the defaults, with a fine-tuning phase that begins and ends a little later."""
    base = method_settings("sprint", TrainingSettings(robot="bp2", seed=1))
    return replace(
        base,
        stages=replace(base.stages, steady_iteration=1000),
        ppo=replace(base.ppo, precision="bfloat16", calm_iterations=(1000, 1850)),
    )


def second_settings() -> TrainingSettings:
    """Time at the top: longer targets and episodes, a range that runs ahead; softer feet, longer strides."""
    base = first_settings()
    assert base.schedule.targets is not None
    targets = replace(base.schedule.targets, persistence=(5.0, 12.0), top_share=0.45)
    return replace(
        base,
        seed=22,
        schedule=replace(base.schedule, targets=targets),
        stages=replace(base.stages, growth_margin=1.5),
        episodes=replace(base.episodes, duration=(14.0, 24.0)),
        ppo=replace(base.ppo, least_std=0.22, calm_iterations=(2300, 3450)),
        rewards=replace(
            base.rewards,
            fine_speed_tracking=4.0,
            fine_speed=1.0,
            fine_yaw_tracking=3.5,
            foot_force_limit=2.6,
            foot_force=RewardWeight(first=-0.5, second=-8.0),
            shortest_stride=0.205,
        ),
    )


def main(options: ScriptOptions) -> Path:
    """Train twice; returns the policy file. ``--resume`` goes on in the training that was stopped.

    Raises:
        SprintlabError: the extra is not installed, or an option or the output folder is refused.
    """
    first = train_part(first_settings(), options, "first", max(1, round(FIRST_SHARE * options.iterations)))
    second = train_part(second_settings(), options, "second", options.iterations, first)
    from sprintlab.training.runs.averaging import average_checkpoints

    return average_checkpoints((first, second), options.output / "policy.onnx").path


def train_part(
    settings: TrainingSettings,
    options: ScriptOptions,
    name: str,
    iterations: int,
    start_from: Path | None = None,
) -> Path:
    """Train in a folder of its own, or go on there; returns the checkpoint. Errors as in ``main``."""
    folder = options.output / name
    resume = options.resume and (folder / "checkpoint.pt").exists()
    chosen = replace(options, output=folder, iterations=iterations, resume=resume)
    begun = None if resume else start_from
    return train_settings(settings, keep_schedule=True, start_from=begun, **vars(chosen))


if __name__ == "__main__":
    run_script(main, DEFAULTS)
