"""Where the time of a training goes: its parts per policy step, its update, and the start.

python benchmarks/training.py --device cuda:0 --output results/engine/training-h100.json
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch
from harness import answer, circumstances

from sprintlab.training.runs.options import TrainOptions
from sprintlab.training.runs.runner import Runner, device_description

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


def measure(chosen: argparse.Namespace) -> dict[str, Any]:
    """Times of the parts [s] and rates [policy steps/s] of a training as `sprintlab train` runs it."""
    options = TrainOptions(device=chosen.device, environments=chosen.robots)
    settings, started = options.full_settings(), time.perf_counter()
    runner = Runner(settings, chosen.device, "benchmarks/training.py")
    environment, learner = runner.environment, runner.learner
    runner.iterate()
    start = time.perf_counter() - started
    parts = {
        "physics": environment.engine.step,
        "physics and environment": environment.advance,
        "acting": learner.act,
        "recording": learner.record,
        "update": learner.update,
        "iteration": runner.iterate,
    }
    times = {name: seconds_of(work, chosen.device) for name, work in parts.items()}
    robots, steps = environment.num_envs, settings.ppo.steps
    return {
        "device": device_description(chosen.device),
        **circumstances(PACKAGES),
        "robots": robots,
        "steps": steps,
        "substeps": settings.simulation.substeps,
        "epochs": settings.ppo.epochs,
        "start_s": start,
        "times_s": times,
        "physics_steps_per_s": robots / times["physics"],
        "training_steps_per_s": robots * steps / times["iteration"],
    }


def show(result: dict[str, Any]) -> None:
    """One line per part."""
    print(f"{result['device']}, {result['robots']} robots: first iteration after {result['start_s']:.1f} s")
    for name, seconds in result["times_s"].items():
        print(f"{name:24s} {1e3 * seconds:10.3f} ms")
    physics, training = result["physics_steps_per_s"], result["training_steps_per_s"]
    print(f"policy steps/s: physics alone {physics:,.0f}, training {training:,.0f}")


if __name__ == "__main__":
    sys.exit(answer(parse, measure, show))
