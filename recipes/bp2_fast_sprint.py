"""Train the policy "sprint-fast" of BP2 in two parts: fast first, then steady.

    python recipes/bp2_fast_sprint.py --output runs/bp2-fast-sprint
    sprintlab export runs/bp2-fast-sprint/checkpoint.pt runs/bp2-fast-sprint/sprint-fast.onnx

Part one, 3600 iterations of 8192 robots, 4.3 minutes on one H200 (236 million environment steps): the
defaults without quiet robots and without commands to brake. Its policy ran 13 m/s and fell when it was asked
to stand: it had never acted without noise, and nobody had ever asked it to stop from more than 1 m/s. Part
two, 1024 robots on two CPU cores, goes on from there: a quarter of the robots with a quarter of the noise,
and commands that brake by up to 4 m/s.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from sprintlab.cli.train import run_script, train_settings
from sprintlab.commands import AdaptiveSchedule
from sprintlab.training.settings import TrainingSettings

FAST_ITERATIONS = 3600
ITERATIONS = 3850
ROBOTS = 1024
LONGEST_MINUTES = 600.0


@dataclass(frozen=True, kw_only=True)
class Options:
    """Where to put the run, and on which device to train.

    Attributes:
        output: folder of the second part; the first lies in ``fast`` below it.
        device: of the first part. The second trains as well on a CPU, as that policy's did.
        steady_device: of the second part.
        resume: go on where it was stopped.
    """

    output: Path = Path("runs/bp2-fast-sprint")
    device: str = "auto"
    steady_device: str = "cpu"
    resume: bool = False


def fast_settings() -> TrainingSettings:
    """The first part: 13 m/s, and hardly able to stand."""
    defaults = TrainingSettings()
    return replace(
        defaults,
        schedule=AdaptiveSchedule(braking_window=1.0),
        ppo=replace(defaults.ppo, precision="bfloat16", quiet_share=0.0),
        stages=replace(defaults.stages, steady_iteration=None),
    )


def shipped_settings() -> TrainingSettings:
    """The second part; the hash of these settings stands in the policy's contract."""
    fast = fast_settings()
    steady = replace(fast.ppo, steps=16, precision="tf32", quiet_share=0.25, quiet_noise=0.25)
    return replace(
        fast,
        schedule=AdaptiveSchedule(braking_window=4.0),
        simulation=replace(fast.simulation, environments=ROBOTS),
        ppo=steady,
    )


def main(options: Options) -> Path:
    """Train both parts; returns the checkpoint of the second.

    Raises:
        SprintlabError: the extra is not installed, or an option or the output folder is refused.
    """
    fast, begun = options.output / "fast" / "checkpoint.pt", (options.output / "checkpoint.pt").exists()
    if not begun:
        train_settings(
            fast_settings(),
            output=fast.parent,
            iterations=FAST_ITERATIONS,
            minutes=LONGEST_MINUTES,
            device=options.device,
            resume=options.resume and fast.exists(),
        )
    return train_settings(
        shipped_settings(),
        output=options.output,
        iterations=ITERATIONS,
        minutes=LONGEST_MINUTES,
        environments=ROBOTS,
        keep_schedule=True,
        device=options.steady_device,
        start_from=None if begun else fast,
        resume=options.resume and begun,
    )


if __name__ == "__main__":
    run_script(main, Options)
