"""The training loop: rollouts, updates, curriculum, log and checkpoints."""

from __future__ import annotations

import copy
import json
import time
from dataclasses import dataclass, replace
from datetime import datetime, timezone
from importlib import metadata
from pathlib import Path
from typing import Any

import torch

from sprintlab.commands import RangeGrowth, StageBlend
from sprintlab.core.errors import SprintlabError
from sprintlab.core.files import atomic_write_text
from sprintlab.core.reading import refused_as_damaged
from sprintlab.robots import robot_fingerprint
from sprintlab.training.environment.constraints import WATCHED, Chances
from sprintlab.training.environment.sprint import SprintEnvironment
from sprintlab.training.exam import Exam, ExamResult
from sprintlab.training.learner.algorithm import EstimatorPpo
from sprintlab.training.learner.distributed import Workers
from sprintlab.training.learner.metric_buffer import joined
from sprintlab.training.runs.checkpoint import Progress, write_checkpoint
from sprintlab.training.runs.options import RunLength
from sprintlab.training.runs.stopwatch import Stopwatch
from sprintlab.training.scaling import speed_scale
from sprintlab.training.settings import TrainingSettings


def device_description(device: str) -> str:
    """The accelerator in words."""
    return torch.cuda.get_device_name(device) if device.startswith("cuda") else "CPU"


EQUAL_SPEED = 0.05
"""Held speeds that differ by less are equal, and the cost of transport decides [m/s]."""
RANGE_GROWTH = 0.1
"""By which the range grows an iteration while robots keep up [m/s], for the robot that the settings are for;
for others by ``scaling``."""
GATED_TOP = 12.0
"""Beyond this speed the range opens only while feet and gears hold [m/s]; scaled likewise."""
EARLIEST_STAGE_TWO, BLENDED_OVER = 250, 250
"""Stage II starts at this iteration at the soonest; its weights are blended in over so many."""
AVERAGED_OVER = 250
"""The exported policy is the mean of the weights over about so many iterations."""


@dataclass(frozen=True, kw_only=True)
class BestExam:
    """The policy that did best in an exam."""

    iteration: int  # iteration at which it was examined
    held: float  # speed within the audit's limits, as far as it was asked for [m/s]
    cost: float  # cost of transport there [-]
    policy: dict[str, torch.Tensor]  # its weights by name

    def beaten_by(self, held: float, cost: float) -> bool:
        """Whether another policy is faster, or as fast and cheaper."""
        if abs(held - self.held) < EQUAL_SPEED:
            return cost < self.cost
        return held > self.held


class Runner:
    """One run: made from settings, or taken up again from its checkpoint.

    Args:
        command_line: Command as typed, which goes into the policy's contract.

    Attributes:
        best: Policy of the best exam so far; None: no exam has kept the audit's limits.
    """

    def __init__(
        self,
        settings: TrainingSettings,
        device: str,
        command_line: str,
        fused: bool = True,
        workers: Workers | None = None,
    ) -> None:
        self.length = RunLength()
        self.workers = workers or Workers()
        torch.set_float32_matmul_precision("high")  # TF32 in the networks
        self.settings, self.device, self.command_line = settings, device, command_line
        self.environment = SprintEnvironment(settings, device, fused, self.workers.rank)
        self.learner = EstimatorPpo(self.environment, fused, self.workers)
        stages = settings.stages
        pace = speed_scale(self.environment.robot)
        self.growth = RangeGrowth(increment=pace * RANGE_GROWTH)
        self._gated_top = pace * GATED_TOP
        self.blend = StageBlend(
            first_top=stages.first_top,
            second_top=stages.second_top,
            earliest_iteration=EARLIEST_STAGE_TWO,
            ramp_iterations=BLENDED_OVER,
        )
        self.chances = None if settings.constraints is None else Chances(settings.constraints)
        self.progress = Progress()
        self.mean = {name: value.clone() for name, value in self.learner.actor.state_dict().items()}
        self._stopwatch = Stopwatch(device)
        self.best: BestExam | None = None
        self.last_exam: ExamResult | None = None
        self._fused, self._exam = fused, None
        self._set_curriculum()

    def begin(self, length: RunLength) -> None:
        """Put the run, new or resumed, into the phase that it is in."""
        self.length = length
        self._set_curriculum()

    @property
    def share(self) -> float:
        """Share of the run that is done, from 0 to 1."""
        return self.length.share(self.progress)

    def iterate(self) -> dict[str, float]:
        """One rollout and one update; returns the statistics of the iteration."""
        started = time.perf_counter()
        for step in range(self.settings.ppo.steps):
            self._policy_step(timed=step == self.settings.ppo.steps - 1)
        self.learner.update()
        self._stopwatch.mark("update")
        self.workers.average(self.environment.grid_weights)
        taken = (self.environment.take_log(), self.learner.take_log())
        statistics = joined(taken, self.workers).read()
        if self.chances is not None:
            self.chances.update(statistics, moving=self.blend.weight >= 1.0)
        if self._may_open():
            self.growth.update(statistics["speed_p95"], self.blend.top)
        self.blend.update(self.growth.upper)
        row = self._record(statistics, self._agreed(time.perf_counter() - started))
        self._average()
        if self._exam_due():
            row |= self.examine()
        self._set_curriculum()
        return row

    def _policy_step(self, timed: bool) -> None:
        """One step of all robots; the last of a rollout is timed part by part."""
        mark = self._stopwatch.mark if timed else lambda name: None
        mark("start")
        self.learner.act()
        mark("acting")
        self.environment.advance(between=lambda: mark("physics"))
        mark("environment")
        self.learner.record()
        mark("recorded")

    # --- exams -------------------------------------------------------------------------------------------

    def _exam_due(self) -> bool:
        settings = self.settings.exam
        return settings is not None and self.progress.iteration % settings.interval == 0

    def examine(self) -> dict[str, float]:
        """Examine the policy, remember it if it is the best so far; returns what the log gets.

        All processes examine the same weights on the same robots, and come to the same result.
        """
        started = time.perf_counter()
        result = self._examiner().run(self.growth.upper)
        self.last_exam, best = result, result.best
        if best is not None and (self.best is None or self.best.beaten_by(best.reached, best.cost)):
            policy = {name: value.clone() for name, value in self.mean.items()}
            iteration = self.progress.iteration
            self.best = BestExam(iteration=iteration, held=best.reached, cost=best.cost, policy=policy)
        seconds = self._agreed(time.perf_counter() - started)
        self.progress.seconds += seconds
        return {**result.row(), "exam/seconds": seconds}

    def examine_at_end(self) -> dict[str, float] | None:
        """Examine the last policy where there have been exams; returns the last row with its numbers."""
        if self.last_exam is None or self._exam_due():
            return None
        self.progress.log[-1] |= self.examine()
        return self.progress.log[-1]

    def _examiner(self) -> Exam:
        """The exam's robots, which act by the mean of the weights."""
        if self._exam is None:
            actor = copy.deepcopy(self.learner.actor)
            actor.load_state_dict(self.mean, assign=True)
            self._exam = Exam(self.settings, self.device, actor, self._fused)
        return self._exam

    @property
    def chosen(self) -> dict[str, torch.Tensor]:
        """Weights of the policy that is exported: that of the best exam, else the present mean."""
        return self.mean if self.best is None else self.best.policy

    def _may_open(self) -> bool:
        """Whether the range of speeds may grow: far up only while feet and gears hold."""
        gated = self.growth.upper >= self._gated_top
        return self.chances is None or not gated or self.chances.held

    def _agreed(self, seconds: float) -> float:
        """Mean over the processes, so that all of them are in the same phase."""
        if not self.workers.several:
            return seconds
        value = torch.tensor(seconds, device=self.device)
        self.workers.average(value)
        return float(value)

    @torch.no_grad()
    def _average(self) -> None:
        """Let the mean of the weights follow; of the first iterations it is the plain mean."""
        weight = 1.0 / min(self.progress.iteration, AVERAGED_OVER)
        now = self.learner.actor.state_dict()
        for name, value in self.mean.items():
            value.lerp_(now[name], weight)

    def _set_curriculum(self) -> None:
        """Range, stage, chances and noise of the next iteration."""
        share = self.share
        steady = self.settings.stages.is_steady(share)
        self.environment.set_curriculum(self.growth.upper, self.growth.lower, self.blend.weight, steady)
        self.learner.set_phase(share)
        if self.chances is not None:
            self.environment.chances.copy_(torch.tensor(self.chances.values))

    def _record(self, statistics: dict[str, float], seconds: float) -> dict[str, float]:
        steps = self.settings.ppo.steps * self.settings.simulation.environments * self.workers.count
        self.progress.iteration += 1
        self.progress.environment_steps += steps
        self.progress.seconds += seconds
        chances = [] if self.chances is None else self.chances.values
        row = {
            "iteration": self.progress.iteration,
            "seconds": round(self.progress.seconds, 3),
            "environment_steps": self.progress.environment_steps,
            "steps_per_second": round(steps / seconds),
            **{
                f"steps_per_second/{part}": round(steps / max(spent, 1e-9))
                for part, spent in self._stopwatch.seconds(self.settings.ppo.steps).items()
            },
            "range_upper": self.growth.upper,
            "stage": self.blend.weight,
            **statistics,
            **{f"chance/{name}": value for name, value in zip(WATCHED, chances, strict=False)},
            "broken": round(statistics["broken"] * steps),  # a count: one in a million steps should be seen
        }
        self.progress.log.append(row)
        return row

    # --- checkpoints -------------------------------------------------------------------------------------

    def state(self) -> dict[str, Any]:
        """Everything that a run needs to go on, and that an export needs to write a contract."""
        return {
            **self._description(),
            "policy": self.chosen,
            "mean": self.mean,
            "best": None if self.best is None else vars(self.best),
            "learner": self.learner.state_dict(),
            "grid_weights": self.environment.grid_weights,
            "growth": vars(self.growth),
            "blend": vars(self.blend),
            "chances": None if self.chances is None else self.chances.state_dict(),
            "length": vars(self.length),
        }

    def _description(self) -> dict[str, Any]:
        """What the file is of, how far it has come, and when and where it was written."""
        return {
            "settings": self.settings,
            "config_hash": self.settings.digest(),
            "robot_fingerprint": robot_fingerprint(self.environment.robot),
            "command_line": self.command_line,
            "device": device_description(self.device),
            "versions": {package: metadata.version(package) for package in ("torch", "mujoco", "numpy")},
            "date": datetime.now(timezone.utc).isoformat(timespec="seconds"),
            "progress": self.progress,
        }

    def save(self, path: Path) -> None:
        """Write the checkpoint in one step; where the disk refuses, the one that was there stays."""
        write_checkpoint(self.state(), path)

    def save_policy(self, path: Path) -> None:
        """Write what ``sprintlab export`` reads and nothing else: a milestone of a run."""
        progress = replace(self.progress, log=[])
        write_checkpoint({**self._description(), "policy": self.mean, "progress": progress}, path)

    def save_log(self, path: Path) -> None:
        """Write one JSON line per iteration."""
        atomic_write_text(path, "".join(json.dumps(row) + "\n" for row in self.progress.log))

    def load(self, state: dict[str, Any]) -> None:
        """Resume a run from its checkpoint; robots start from standing, with new random numbers.

        A milestone, a policy without what training needs, is refused with ``SprintlabError``.
        """
        if "learner" not in state:
            raise SprintlabError("a milestone holds a policy only: it can be exported, not trained further")
        with refused_as_damaged("the checkpoint", "does not fit this run"):
            self.learner.load_state_dict(state["learner"])
            self.growth = replace(self.growth, **state["growth"])
            self.blend = replace(self.blend, **state["blend"])
            if self.chances is not None:
                self.chances.load_state_dict(state["chances"])
            for name, value in self.mean.items():
                value.copy_(state["mean"][name])
            self.best = None if state["best"] is None else BestExam(**state["best"])
            self.environment.grid_weights.copy_(state["grid_weights"])
            self.progress = state["progress"]
            torch.manual_seed(self.settings.seed + 1_000_003 * self.workers.rank + self.progress.iteration)
            self.begin(RunLength(**state["length"]))
