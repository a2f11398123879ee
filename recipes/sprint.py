"""Train the shipped policy ``sprint``: bp2 with a gait that an audit can look at.

    python recipes/sprint.py --output runs/sprint
    sprintlab race runs/sprint/policy.onnx

The defaults of ``sprintlab train sprint`` with half their iterations: quiet robots and less action noise from
iteration 1100 on. The shipped run ended after 1641 iterations, when its time was up.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from sprintlab.api.training import ScriptOptions, run_script, train_settings
from sprintlab.training.methods import method_settings
from sprintlab.training.settings import TrainingSettings

DEFAULTS = ScriptOptions(output=Path("runs/sprint"), iterations=1650, minutes=5.25)


def sprint_settings() -> TrainingSettings:
    """Seed 1 of the method ``sprint``, with its last phase from iteration 1100 on."""
    base = method_settings("sprint", TrainingSettings(robot="bp2", seed=1))
    return replace(
        base,
        stages=replace(base.stages, steady_iteration=1100),
        ppo=replace(base.ppo, precision="bfloat16", calm_iterations=(1100, 1650)),
    )


def main(options: ScriptOptions) -> Path:
    """Train; returns the checkpoint.

    Raises:
        SprintlabError: the extra is not installed, or an option or the output folder is refused.
    """
    return train_settings(sprint_settings(), keep_schedule=True, **vars(options))


if __name__ == "__main__":
    run_script(main, DEFAULTS)
