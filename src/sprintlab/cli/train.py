"""``sprintlab train``."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from sprintlab.api.training import require_training


@dataclass(frozen=True, kw_only=True)
class Train:
    """Train a policy for a robot.

    Attributes:
        robot: name, folder or table of the robot.
        method: acs-like methods and those that they are compared with: sprint, baseline, no-envelope,
            simplified-dc, fixed-acceleration, uniform-commands, literal-acs, no-saturation, rlvrl, lp-acrl,
            after-hacl, hound, stride-prior.
        preset: sprintlab, or paper: the paper's reward table to the letter.
        output: folder of the run: checkpoint, log, run.toml and, at its end, policy.onnx.
        seed: of every random generator.
        minutes: training time; without it and iterations 7 on a GPU, 60 on a CPU.
        iterations: stop at this iteration of the run.
        settings: TOML file of settings, such as the run.toml of another run.
        set: a setting and its value, e.g. reward.touchdown.weight=-8; may be repeated.
        device: cuda:0, cpu or auto.
        resume: go on from the checkpoint in the folder.
        save_seconds: time between checkpoints.
        milestones: keep the policy at every multiple of this training time [s].
        keep_robots: put the state of every robot into the checkpoint.
        plain: no curves for TensorBoard.
        wandb: project on Weights & Biases that gets the curves.
        figures: draw the learning curve at the end.
    """

    robot: tyro.conf.Positional[str] = "bp2"
    method: str = "sprint"
    preset: str = "sprintlab"
    output: Path = Path("runs/train")
    seed: int = 0
    minutes: float | None = None
    iterations: int | None = None
    settings: Path | None = None
    set: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    device: str = "auto"
    resume: bool = False
    save_seconds: float = 60.0
    milestones: float | None = None
    keep_robots: bool = False
    plain: bool = False
    wandb: str | None = None
    figures: bool = False

    def run(self) -> int:
        """Train, export, and say what comes next.

        Raises:
            SprintlabError: the extra is missing, or an option or the file is refused.
        """
        require_training()
        from sprintlab.training.methods import method
        from sprintlab.training.runs.options import TrainOptions, check_places
        from sprintlab.training.settings_text import read_settings, with_changes

        chosen = method(self.method, robot=self.robot, preset=self.preset, seed=self.seed)
        if self.settings is not None:
            chosen = read_settings(self.settings, chosen)
        options = TrainOptions(
            settings=with_changes(chosen, self.set),
            output=self.output,
            minutes=self.minutes,
            iterations=self.iterations,
            device=self.device,
            resume=self.resume,
            save_seconds=self.save_seconds,
            milestones=self.milestones,
            keep_robots=self.keep_robots,
            tensorboard=not self.plain,
            wandb=self.wandb,
            figures=self.figures,
        )
        check_places(options)  # before PyTorch is imported, which takes many seconds
        from sprintlab.training.runs.run import train

        checkpoint = train(options)
        if os.environ.get("RANK", "0") == "0":  # of several processes, one speaks
            _tell(checkpoint.parent, options.settings.robot)
        return 0


def _tell(folder: Path, robot: str) -> None:
    """What the training reached, and the next command."""
    from rich.console import Console

    from sprintlab.api.reached import what_was_reached

    console = Console(stderr=True, highlight=False)
    console.print(
        f"policy: {folder / 'policy.onnx'}; three trials in the plant tell what it reached", soft_wrap=True
    )
    for part in what_was_reached(folder, robot):
        console.print(part, soft_wrap=isinstance(part, str), markup=not isinstance(part, str))
