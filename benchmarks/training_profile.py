"""Where each microsecond of training goes: every phase of an iteration by kernel, on one GPU.

    python benchmarks/training_profile.py --output results/throughput/profile.json

An iteration is so many times act, physics, the rest of the step and record, then the update. Each phase is
run ``--repeats`` times on its own under CUPTI, after a few whole iterations have set the robots moving. Per
phase and per policy step of all environments: time on the device from the first kernel's start to the last
one's end, how many kernels, how long they are busy, and which kinds take how much of that.
"""

from __future__ import annotations

import argparse
import os
import re
import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, NamedTuple

os.environ.setdefault("MUJOCO_GL", "disabled")

import torch
from harness import answer, circumstances
from rich.console import Console
from rich.table import Table
from torch.profiler import ProfilerActivity, profile

from sprintlab.core.checks import check_range
from sprintlab.core.errors import SprintlabError
from sprintlab.training.runs.runner import Runner, device_description
from sprintlab.training.settings import PRECISIONS, TrainingSettings

PACKAGES = ("sprintlab", "torch", "warp-lang", "mujoco-warp")
WARM_UP_ITERATIONS = 5
LARGEST_KERNELS = 12
KINDS = (
    ("motor law", r"joint_torque|supply|bus_voltage"),
    ("matrix products", r"gemm|cutlass|xmma|cublas|nvjet|splitK|gemv"),
    ("Adam", r"adam|multi_tensor"),
    ("compiled by inductor", r"^triton_"),
    ("PyTorch's own", r"at::native|^void at::|Memcpy|Memset|elementwise|distribution"),
    ("MuJoCo Warp", r"_cuda_kernel_forward|^_"),
)
"""Kinds of kernels by what their names match; the first that fits counts."""


class Kernel(NamedTuple):
    """One launch on the device, times in microseconds."""

    name: str
    start: float
    duration: float


def kind_of(name: str) -> str:
    """Which of ``KINDS`` a kernel is."""
    return next((kind for kind, pattern in KINDS if re.search(pattern, name)), "other")


def kernels_of(work: Callable[[], object]) -> list[Kernel]:
    """What ``work`` launches on the device, in order."""
    with profile(activities=[ProfilerActivity.CUDA]) as profiler:
        work()
        torch.cuda.synchronize()
    events = [event for event in profiler.events() if event.device_type == torch.autograd.DeviceType.CUDA]
    found = [Kernel(e.name, e.time_range.start, e.time_range.elapsed_us()) for e in events]
    return sorted(found, key=lambda kernel: kernel.start)


def summary(kernels: list[Kernel], repeats: int, steps: float) -> dict[str, Any]:
    """Of ``repeats`` runs of a phase that serves ``steps`` policy steps each: everything per policy step."""
    share = 1.0 / (repeats * steps)
    kinds, names, counts = Counter[str](), Counter[str](), Counter[str]()
    for kernel in kernels:
        kinds[kind_of(kernel.name)] += kernel.duration * share
        names[kernel.name] += kernel.duration * share
        counts[kernel.name] += 1
    span = kernels[-1].start + kernels[-1].duration - kernels[0].start if kernels else 0.0
    largest = [
        {"name": name, "microseconds": time, "launches": counts[name] * share, "kind": kind_of(name)}
        for name, time in names.most_common(LARGEST_KERNELS)
    ]
    return {
        "microseconds": span * share,
        "busy_microseconds": sum(kinds.values()),
        "kernels": len(kernels) * share,
        "kinds": dict(kinds.most_common()),
        "largest": largest,
    }


def phases(runner: Runner) -> dict[str, tuple[Callable[[], object], float]]:
    """Name of each phase, what does it, and how many policy steps it serves."""
    environment, learner = runner.environment, runner.learner
    return {
        "act": (learner.act, 1),
        "physics": (environment.simulation.step, 1),
        "rest of the step": (environment._finish_step, 1),
        "record": (learner.record, 1),
        "update": (learner.update, runner.settings.ppo.steps),
    }


def measure(chosen: argparse.Namespace) -> dict[str, Any]:
    """All phases of a training, and everything that the numbers depend on.

    Raises:
        SprintlabError: there is no GPU.
    """
    if not torch.cuda.is_available():
        raise SprintlabError("a profile needs a CUDA device, and there is none")
    defaults = TrainingSettings()
    settings = replace(
        defaults,
        simulation=replace(defaults.simulation, environments=chosen.environments),
        ppo=replace(defaults.ppo, precision=chosen.precision),
    )
    runner = Runner(settings, chosen.device, "profile")
    for _ in range(WARM_UP_ITERATIONS):
        runner.iterate()
    torch.cuda.synchronize()
    measured: dict[str, Any] = {}
    for name, (work, steps) in phases(runner).items():
        kernels = kernels_of(lambda work=work: [work() for _ in range(chosen.repeats)])
        measured[name] = summary(kernels, chosen.repeats, steps)
    return {**description(settings, chosen.device), "phases": measured}


def description(settings: TrainingSettings, device: str) -> dict[str, Any]:
    """Everything that the numbers depend on."""
    return {
        "device": device_description(device),
        "cuda": torch.version.cuda,
        **circumstances(PACKAGES),
        "simulation": asdict(settings.simulation),
        "ppo": asdict(settings.ppo),
    }


def show(result: dict[str, Any]) -> None:
    """A table of the phases, and one of the largest kernels."""
    console = Console()
    whole = sum(phase["microseconds"] for phase in result["phases"].values())
    table = Table(
        "phase",
        "µs",
        "share",
        "busy µs",
        "kernels",
        "of which µs",
        title=f"One policy step, {result['device']}",
    )
    for name, phase in result["phases"].items():
        kinds = ", ".join(f"{kind} {time:.0f}" for kind, time in phase["kinds"].items() if time >= 0.5)
        numbers = (f"{phase['microseconds']:.0f}", f"{100 * phase['microseconds'] / whole:.1f} %")
        table.add_row(name, *numbers, f"{phase['busy_microseconds']:.0f}", f"{phase['kernels']:.0f}", kinds)
    console.print(table)
    kernels = Table("phase", "kernel", "µs", "launches")
    for name, phase in result["phases"].items():
        for kernel in phase["largest"]:
            row = (f"{kernel['microseconds']:.1f}", f"{kernel['launches']:.1f}")
            kernels.add_row(name, kernel["name"][:70], *row)
    console.print(kernels)


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """The command line, checked."""
    parser = argparse.ArgumentParser(description="Where each microsecond of training goes.")
    parser.add_argument("--environments", type=int, default=8192)
    parser.add_argument("--device", default="cuda:0")
    parser.add_argument("--repeats", type=int, default=5, help="runs of each phase")
    parser.add_argument("--precision", choices=PRECISIONS, default="tf32")
    parser.add_argument("--output", type=Path, help="JSON file")
    parser.add_argument("--json", action="store_true", help="print JSON instead of tables")
    chosen = parser.parse_args(arguments)
    check_range("environments", chosen.environments, 1, 10**6)
    check_range("repeats", chosen.repeats, 1, 1000)
    return chosen


if __name__ == "__main__":
    sys.exit(answer(parse, measure, show))
