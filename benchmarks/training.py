"""Where the time of a training goes: start, parts per policy step, update, exam; and whether it repeats.

python benchmarks/training.py --device cuda:0 --output results/engine/training-h100.json
"""

# ruff: noqa: E402
from __future__ import annotations

import time

BEGAN = time.perf_counter()  # the imports are part of the start

import argparse
import hashlib
import os
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # as the command line has it

import torch
from harness import answer, circumstances

from sprintlab.training.environment.sprint import SUBSTEPS
from sprintlab.training.runs.options import TrainOptions
from sprintlab.training.runs.runner import Runner, device_description
from sprintlab.training.settings import ExamSettings, TrainingSettings

IMPORTED = time.perf_counter()
ITERATIONS = 4
"""Of the two trainings that are compared; every second one has an exam."""
PACKAGES = ("sprintlab", "torch", "mujoco", "numpy")


def parse() -> argparse.Namespace:
    """Options of the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--device", default="cuda:0" if torch.cuda.is_available() else "cpu")
    parser.add_argument("--robots", type=int, help="as a training on this device when left out")
    parser.add_argument("--output", type=Path)
    parser.add_argument("--json", action="store_true")
    return parser.parse_args()


def seconds_of(work: Callable[[], object], device: str, budget: float = 1.0) -> float:
    """Least time [s] of one call among repeats that fill the budget [s], after one call to warm up."""
    wait = torch.cuda.synchronize if device.startswith("cuda") else (lambda: None)

    def timed() -> float:
        started = time.perf_counter()
        work()
        wait()
        return time.perf_counter() - started

    timed()
    first = timed()
    return min([first, *(timed() for _ in range(min(200, int(budget / first))))])


class TimedRunner(Runner):
    """A run that notes how long its environment and its learner took to be made."""

    def __init__(self, settings: TrainingSettings, device: str) -> None:
        self.start_s = {"imports": IMPORTED - BEGAN}
        began = time.perf_counter()
        super().__init__(settings, device, "benchmarks/training.py")
        self.start_s["environment and learner"] = time.perf_counter() - began
        began = time.perf_counter()
        self.iterate()
        self.start_s["first iteration"] = time.perf_counter() - began

    def trained(self) -> str:
        """SHA-256 of all parameters after ``ITERATIONS``."""
        while self.progress.iteration < ITERATIONS:
            self.iterate()
        digest = hashlib.sha256()
        for network in (self.learner.actor, self.learner.critic):
            for value in network.state_dict().values():
                digest.update(value.cpu().numpy().tobytes())
        return digest.hexdigest()


def measure(chosen: argparse.Namespace) -> dict[str, Any]:
    """Times of the parts [s] and rates [policy steps/s] of a training as `sprintlab train` runs it."""
    options = TrainOptions(device=chosen.device, environments=chosen.robots)
    settings = replace(options.full_settings(), exam=ExamSettings(interval=2))
    runner = TimedRunner(settings, chosen.device)
    start, first = runner.start_s, runner.trained()
    environment, learner, exams = runner.environment, runner.learner, runner.progress.log[1::2]
    parts = {
        "physics": environment.engine.step,
        "physics and environment": environment.advance,
        "acting": learner.act,
        "recording": learner.record,
        "update": learner.update,
    }
    times = {name: seconds_of(work, chosen.device) for name, work in parts.items()}
    runner.settings = replace(settings, exam=None)
    times["iteration"] = seconds_of(runner.iterate, chosen.device)
    runner.growth.upper = settings.stages.second_top
    times["exam up to the highest speed"] = runner.examine()["exam/seconds"]
    robots, steps, exam = environment.num_envs, settings.ppo.steps, times["exam up to the highest speed"]
    every = (options.full_settings().exam or ExamSettings()).interval
    del runner, environment, learner, parts
    return {
        "device": device_description(chosen.device),
        **circumstances(PACKAGES),
        "robots": robots,
        "steps": steps,
        "substeps": SUBSTEPS,
        "epochs": settings.ppo.epochs,
        "start_s": start,
        "first_exam_s": exams[0]["exam/seconds"],
        "times_s": times,
        "exam_share": exam / (exam + every * times["iteration"]),
        "repeats": first == TimedRunner(settings, chosen.device).trained(),
        "physics_steps_per_s": robots / times["physics"],
        "training_steps_per_s": robots * steps / times["iteration"],
    }


def show(result: dict[str, Any]) -> None:
    """One line per part."""
    start = result["start_s"]
    print(f"{result['device']}, {result['robots']} robots: first iteration after {sum(start.values()):.1f} s")
    for name, seconds in start.items():
        print(f"  {name:30s} {seconds:8.1f} s")
    for name, seconds in result["times_s"].items():
        print(f"{name:32s} {1e3 * seconds:8.3f} ms")
    print(f"exams take {100 * result['exam_share']:.1f} %; the first takes {result['first_exam_s']:.1f} s")
    physics, training = result["physics_steps_per_s"], result["training_steps_per_s"]
    print(f"policy steps/s: physics alone {physics:,.0f}, training {training:,.0f}")
    print("one seed gives one network, bit for bit:", "yes" if result["repeats"] else "NO")


if __name__ == "__main__":
    sys.exit(answer(parse, measure, show))
