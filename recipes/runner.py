"""Train the shipped policy ``runner``: bp2, second edition, with a gait that an audit can look at.

    python recipes/runner.py --output runs/runner
    sprintlab race runs/runner/policy.onnx

The defaults of ``sprintlab train sprint`` with half their iterations: quiet robots and less action noise from
iteration 1100 on. The shipped run ended after 1641 iterations, when its time was up.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from sprintlab.api.training import run_script, train_settings
from sprintlab.training.methods import method_settings
from sprintlab.training.settings import TrainingSettings

ITERATIONS = 1650
LONGEST_MINUTES = 5.25


@dataclass(frozen=True, kw_only=True)
class Options:
    """Where to put the run, how long to train, on which device, with how many robots."""

    output: Path = Path("runs/runner")
    iterations: int = ITERATIONS
    environments: int = 8192
    device: str = "auto"
    resume: bool = False


def runner_settings() -> TrainingSettings:
    """Seed 1 of the method ``sprint``, with its last phase from iteration 1100 on."""
    base = method_settings("sprint", TrainingSettings(robot="bp2", seed=1))
    return replace(
        base,
        stages=replace(base.stages, steady_iteration=1100),
        ppo=replace(base.ppo, precision="bfloat16", calm_iterations=(1100, 1650)),
    )


def main(options: Options) -> Path:
    """Train; returns the checkpoint.

    Raises:
        SprintlabError: the extra is not installed, or an option or the output folder is refused.
    """
    return train_settings(runner_settings(), keep_schedule=True, minutes=LONGEST_MINUTES, **vars(options))


if __name__ == "__main__":
    run_script(main, Options)
