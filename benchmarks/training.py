"""Where the time of a training goes: start, each part of an iteration, exam; and whether it repeats.

Beside it, the rate of whole trainings on two CPU cores and, where there are two GPUs, on both.

python benchmarks/training.py --device cuda:0 --output results/engine/training-NAME.json
"""

# ruff: noqa: E402
from __future__ import annotations

import time

BEGAN = time.perf_counter()  # the imports are part of the start

import argparse
import hashlib
import json
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # as the command line has it

import torch
from harness import answer, circumstances

from sprintlab.training.environment.sprint import SUBSTEPS
from sprintlab.training.learner.distributed import Workers, join_workers
from sprintlab.training.runs.options import TrainOptions
from sprintlab.training.runs.runner import Runner, device_description
from sprintlab.training.settings import ExamSettings, TrainingSettings

IMPORTED = time.perf_counter()
ITERATIONS = 4
"""Iterations of the two trainings that are compared; every second one has an exam."""
PACKAGES = ("sprintlab", "torch", "mujoco", "numpy")


def parse() -> argparse.Namespace:
    """Options of the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--device", default="cuda:0" if torch.cuda.is_available() else "cpu")
    parser.add_argument("--robots", type=int, help="as a training on this device when left out")
    parser.add_argument("--alone", action="store_true", help="nothing on two CPU cores or two GPUs")
    parser.add_argument("--rate", action="store_true", help="print the rate of a whole training and no more")
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


def training_rate(chosen: argparse.Namespace, workers: Workers) -> float:
    """Policy steps/s of a whole training without exams, of all processes together."""
    settings = replace(
        TrainOptions(device=chosen.device, environments=chosen.robots).full_settings(), exam=None
    )
    on_gpus = workers.several and chosen.device.startswith("cuda")
    device = f"cuda:{workers.local_rank}" if on_gpus else chosen.device
    runner = Runner(settings, device, "benchmarks/training.py", workers=workers)
    runner.iterate()
    rows = [runner.iterate() for _ in range(5)]
    if workers.several:
        runner.learner.release_graphs()
    return max(row["steps_per_second"] for row in rows)


def rate_elsewhere(*command: str, cores: int | None = None) -> float:
    """What a process of its own prints as its rate; on so many cores of the CPU."""
    some = None if cores is None else sorted(os.sched_getaffinity(0))[:cores]
    confined = None if some is None else (lambda: os.sched_setaffinity(0, some))
    threads = {} if cores is None else {"OMP_NUM_THREADS": str(cores)}
    done = subprocess.run(
        [sys.executable, *command],
        env=os.environ | threads,
        preexec_fn=confined,
        stdout=subprocess.PIPE,
        check=True,
    )
    return float(json.loads(done.stdout.decode().splitlines()[-1]))


def rates_elsewhere(chosen: argparse.Namespace) -> dict[str, float]:
    """Policy steps/s on two CPU cores and, where there are two GPUs, on both."""
    if chosen.alone:
        return {}
    size = [] if chosen.robots is None else ["--robots", str(chosen.robots)]
    rates = {"two CPU cores": rate_elsewhere(__file__, "--rate", "--device", "cpu", *size, cores=2)}
    if chosen.device.startswith("cuda") and torch.cuda.device_count() > 1:
        launch = ("-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2")
        rates["two GPUs"] = rate_elsewhere(*launch, __file__, "--rate", *size)
    return rates


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
        "environment": environment.after_physics,
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
        "rates_elsewhere": rates_elsewhere(chosen),
    }


def show(result: dict[str, Any]) -> None:
    """One line per part."""
    start = result["start_s"]
    print(f"{result['device']}, {result['robots']} robots: first iteration after {sum(start.values()):.1f} s")
    for name, seconds in start.items():
        print(f"  {name:30s} {seconds:8.1f} s")
    times, steps = dict(result["times_s"]), result["steps"]
    exam, whole = times.pop("exam up to the highest speed"), times["iteration"]
    print(f"{'of an iteration of ' + str(steps) + ' steps':32s} {'ms once':>8s}   share")
    for name, seconds in times.items():
        count = 1 if name in ("update", "iteration") else steps
        print(f"  {name:30s} {1e3 * seconds:8.3f} {100 * count * seconds / whole:6.1f} %")
    print(
        f"exam of {exam:.2f} s: {100 * result['exam_share']:.1f} %; the first {result['first_exam_s']:.1f} s"
    )
    physics, training = result["physics_steps_per_s"], result["training_steps_per_s"]
    print(f"policy steps/s: physics alone {physics:,.0f}, training {training:,.0f}")
    for name, rate in result["rates_elsewhere"].items():
        share = f", {rate / training:.2f} of one" if name == "two GPUs" else ""
        print(f"policy steps/s on {name}: {rate:,.0f}{share}")
    print("one seed gives one network, bit for bit:", "yes" if result["repeats"] else "NO")


def main() -> int:
    """A benchmark, or one rate for another process that measures."""
    if not parse().rate:
        return answer(parse, measure, show)
    workers = join_workers()
    rate = training_rate(parse(), workers)
    if workers.leads:
        print(json.dumps(rate))
    return 0


if __name__ == "__main__":
    sys.exit(main())
