"""The training loop: rollouts, updates, curriculum, log and checkpoints."""

from __future__ import annotations

import io
import json
import random
import sys
import time
from dataclasses import dataclass, field
from datetime import datetime, timezone
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import torch

from sprintlab.commands import RangeGrowth, StageBlend
from sprintlab.core.errors import SprintlabError
from sprintlab.core.files import atomic_write_bytes, atomic_write_text
from sprintlab.training.environment import SprintEnvironment
from sprintlab.training.learner import build_learner
from sprintlab.training.settings import TrainingSettings

CHECKPOINT_FORMAT = 1
_PACKAGES = ("torch", "mujoco", "mujoco-warp", "warp-lang", "rsl-rl-lib", "numpy")


def device_description(device: str) -> str:
    """The accelerator in words."""
    return torch.cuda.get_device_name(device) if device.startswith("cuda") else "CPU"


def package_versions() -> dict[str, str]:
    """Versions of what a policy depends on."""
    return {package: metadata.version(package) for package in _PACKAGES}


@dataclass
class Progress:
    """What has been done, over all sittings of a run."""

    iteration: int = 0
    environment_steps: int = 0
    seconds: float = 0.0
    log: list[dict[str, float]] = field(default_factory=list)


class Runner:
    """One run: made from settings, or taken up again from its checkpoint.

    Args:
        settings: the whole configuration.
        device: ``"cuda:0"`` or ``"cpu"``.
        command_line: as typed; goes into the policy's contract.
    """

    def __init__(self, settings: TrainingSettings, device: str, command_line: str) -> None:
        random.seed(settings.seed)
        np.random.seed(settings.seed)
        torch.set_float32_matmul_precision("high")  # TF32 in the networks, as mjlab sets it
        self.settings, self.device, self.command_line = settings, device, command_line
        self.environment = SprintEnvironment(settings, device)
        self.learner = build_learner(self.environment, settings.ppo)
        stages = settings.stages
        self.growth = RangeGrowth(increment=stages.growth, margin=stages.growth_margin)
        self.blend = StageBlend(
            first_top=stages.first_top,
            second_top=stages.second_top,
            earliest_iteration=stages.earliest_iteration,
            ramp_iterations=stages.ramp_iterations,
        )
        self.progress = Progress()

    def iterate(self) -> dict[str, float]:
        """One rollout and one update; returns the statistics of the iteration."""
        started = time.perf_counter()
        self._collect()
        losses = self.learner.update()
        statistics = self.environment.take_log()
        self._advance_curriculum(statistics["speed_p999"])
        return self._record(statistics, losses, time.perf_counter() - started)

    def _collect(self) -> None:
        observation = self.environment.get_observations()
        with torch.inference_mode():
            for _ in range(self.settings.ppo.steps):
                # The transition keeps the observation until it is stored, and the environment's buffers move.
                action = self.learner.act(observation.clone())
                observation, reward, done, extras = self.environment.step(action)
                self.learner.process_env_step(observation, reward, done, extras)
            self.learner.compute_returns(observation)

    def _advance_curriculum(self, fastest: float) -> None:
        self.growth.update(fastest, self.blend.top)
        self.blend.update(self.growth.upper)
        self.environment.set_curriculum(self.growth.upper, self.growth.lower, self.blend.weight)

    def _record(
        self, statistics: dict[str, float], losses: dict[str, float], seconds: float
    ) -> dict[str, float]:
        steps = self.settings.ppo.steps * self.settings.simulation.environments
        self.progress.iteration += 1
        self.progress.environment_steps += steps
        self.progress.seconds += seconds
        row = {
            "iteration": self.progress.iteration,
            "seconds": round(self.progress.seconds, 3),
            "environment_steps": self.progress.environment_steps,
            "steps_per_second": round(steps / seconds),
            "range_upper": self.growth.upper,
            "stage": self.blend.weight,
            "action_std": float(self.learner.get_policy().output_std.detach().mean()),
            "learning_rate": self.learner.learning_rate,
            **{f"loss/{name}": value for name, value in losses.items()},
            **statistics,
        }
        self.progress.log.append(row)
        return row

    # --- checkpoints -------------------------------------------------------------------------------------

    def state(self) -> dict[str, Any]:
        """Everything that a run needs to go on, and that an export needs to write a contract."""
        generators = {
            "torch": torch.get_rng_state(),
            "numpy": np.random.get_state(),
            "python": random.getstate(),
        }
        if self.device.startswith("cuda"):
            generators["cuda"] = torch.cuda.get_rng_state(self.device)
        return {
            "format": CHECKPOINT_FORMAT,
            "settings": self.settings,
            "learner": self.learner.save(),
            "growth": self.growth.state_dict(),
            "blend": self.blend.state_dict(),
            "progress": self.progress,
            "generators": generators,
            "command_line": self.command_line,
            "device": device_description(self.device),
            "versions": package_versions(),
            "date": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        }

    def save(self, path: Path) -> None:
        """Write the checkpoint in one step. Raises ``SprintlabError`` if the disk refuses."""
        buffer = io.BytesIO()
        torch.save(self.state(), buffer)
        atomic_write_bytes(path, buffer.getvalue())

    def save_log(self, path: Path) -> None:
        """Write one JSON line an iteration."""
        atomic_write_text(path, "".join(json.dumps(row) + "\n" for row in self.progress.log))

    def load(self, state: dict[str, Any]) -> None:
        """Take up a run where its checkpoint left it; robots start anew from standing."""
        self.learner.load(state["learner"], None, True)
        self.growth.load_state_dict(state["growth"])
        self.blend.load_state_dict(state["blend"])
        self.progress = state["progress"]
        self.environment.set_curriculum(self.growth.upper, self.growth.lower, self.blend.weight)
        generators = state["generators"]
        torch.set_rng_state(generators["torch"].cpu())
        np.random.set_state(generators["numpy"])
        random.setstate(generators["python"])
        if self.device.startswith("cuda") and "cuda" in generators:
            torch.cuda.set_rng_state(generators["cuda"].cpu(), self.device)


def read_checkpoint(path: Path) -> dict[str, Any]:
    """Load a checkpoint of ours.

    Raises:
        SprintlabError: missing, truncated, or written by something else.
    """
    if not path.is_file():
        raise SprintlabError(f"{path} is no checkpoint: there is no such file")
    try:
        state = torch.load(path, map_location="cpu", weights_only=False)
    except Exception as error:
        raise SprintlabError(f"{path} is no checkpoint or is truncated: {error}") from error
    if not isinstance(state, dict) or state.get("format") != CHECKPOINT_FORMAT:
        raise SprintlabError(f"{path} is no sprintlab checkpoint of format {CHECKPOINT_FORMAT}")
    return state


def command_line() -> str:
    """The command as typed, without the folder of the program."""
    return " ".join([Path(sys.argv[0]).name, *sys.argv[1:]])
