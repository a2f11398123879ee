"""What the motor law costs: points a second in NumPy, and its share of a physics substep in training.

    python benchmarks/motor_law.py --json

The NumPy part times ``torque_limits`` on ``--points`` speeds over all four quadrants. The Warp part times
what training runs before every physics substep (bus voltage where there is a battery, then PD, motor law,
heat, friction and end stops of all joints) against the substep itself, both as CUDA graphs of ``LAUNCHES``
launches; on the CPU, where there are no graphs, one by one. Every number is the median of ``--repeats``
samples.
"""

from __future__ import annotations

import argparse
import os
import platform
import shlex
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

os.environ.setdefault("MUJOCO_GL", "disabled")

import numpy as np
from harness import answer, package_version
from rich.console import Console
from rich.table import Table

from sprintlab.core.checks import check_range
from sprintlab.motors import MOTOR_MODELS, Battery, WindingHeat, load_library_motor, torque_limits

LAUNCHES = 20
SETTLING_STEPS = 25
"""Policy steps (0.5 s) from the standing pose before the clock runs: feet are on the ground."""
VARIANTS: dict[str, dict[str, Any]] = {
    "refined": {},
    "simplified-dc": {},
    "square": {},
    "flux-weakening": {},
    "refined, heat": {"heat": WindingHeat()},
    "refined, battery": {"battery": Battery()},
    "flux-weakening, battery, heat": {"battery": Battery(), "heat": WindingHeat()},
}


def numpy_seconds(points: int, repeats: int) -> dict[str, float]:
    """Seconds that ``points`` envelope points take, by model, double precision, one thread."""
    actuator = load_library_motor("mit-humanoid-u12")
    speed = np.random.default_rng(0).uniform(-600.0, 600.0, points)
    return {
        model: median_seconds(
            lambda model=model: torque_limits(actuator.motor, speed, actuator.bus_voltage, model), repeats
        )
        for model in MOTOR_MODELS
    }


def median_seconds(
    work: Callable[[], object], repeats: int, wait: Callable[[], object] = lambda: None
) -> float:
    """Median duration of ``work`` until ``wait`` returns; one run before the first counts is thrown away."""
    samples: list[float] = []
    for _ in range(repeats + 1):
        wait()
        started = time.perf_counter()
        work()
        wait()
        samples.append(time.perf_counter() - started)
    return statistics.median(samples[1:])


def warp_seconds(environments: int, device: str, repeats: int) -> dict[str, Any]:
    """Seconds of one physics substep, and of the motor law before it by variant."""
    import mujoco_warp
    import warp as wp

    from sprintlab.robots import load_robot
    from sprintlab.training.environment.simulation import BatchSimulation
    from sprintlab.training.settings import SimulationSettings

    robot, physics = load_robot("bp2"), None
    law: dict[str, float] = {}
    for name, supply in VARIANTS.items():
        settings = SimulationSettings(environments=environments, **supply)
        simulation = BatchSimulation(robot, settings, name.split(",")[0], device)
        for _ in range(SETTLING_STEPS):
            simulation.step()
        law[name] = launch_seconds(lambda s=simulation: s.actuate(0), device, repeats)
        if physics is None:
            physics = launch_seconds(lambda s=simulation: mujoco_warp.step(s.model, s.data), device, repeats)
    return {
        "device": wp.get_device(device).name,
        "environments": environments,
        "joints": len(robot.joint_names),
        "timestep_s": SimulationSettings().timestep,
        "physics_substep_s": physics,
        "law_s": law,
        "share_of_substep": {name: seconds / physics for name, seconds in law.items()},
    }


def launch_seconds(work: Callable[[], object], device: str, repeats: int) -> float:
    """Seconds of one ``work``, of ``LAUNCHES`` in a row; as one graph on CUDA."""
    import warp as wp

    def many() -> None:
        for _ in range(LAUNCHES):
            work()

    target = wp.get_device(device)
    with wp.ScopedDevice(target):
        run: Callable[[], object] = many
        if target.is_cuda:
            work()  # compiles what a capture cannot
            with wp.ScopedCapture() as capture:
                many()
            run = lambda: wp.capture_launch(capture.graph)  # noqa: E731
        return median_seconds(run, repeats, lambda: wp.synchronize_device(target)) / LAUNCHES


def default_device() -> str:
    """The first GPU where there is one."""
    import torch

    return "cuda:0" if torch.cuda.is_available() else "cpu"


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """The command line, checked."""
    parser = argparse.ArgumentParser(description="What the motor law costs.")
    parser.add_argument("--points", type=int, default=1_000_000, help="envelope points in NumPy")
    parser.add_argument("--environments", type=int, help="8192 on a GPU, 64 on the CPU")
    parser.add_argument("--device", help="cuda:0 where there is one")
    parser.add_argument("--repeats", type=int, default=15, help="samples of each number")
    parser.add_argument("--numpy-only", action="store_true", help="leave Warp out")
    parser.add_argument("--output", type=Path, help="write the JSON here")
    parser.add_argument("--json", action="store_true", help="print JSON only")
    chosen = parser.parse_args(arguments)
    check_range("points", chosen.points, 1, 10**8)
    check_range("repeats", chosen.repeats, 1, 10**4)
    check_range("environments", chosen.environments or 1, 1, 10**6)
    return chosen


def measure(chosen: argparse.Namespace) -> dict[str, Any]:
    """Everything, ready for JSON."""
    result: dict[str, Any] = {
        "command": shlex.join(["python", *sys.argv]),
        "python": platform.python_version(),
        "machine": platform.machine(),
        "versions": {name: package_version(name) for name in ("numpy", "sprintlab")},
        "numpy": {"points": chosen.points, "seconds": numpy_seconds(chosen.points, chosen.repeats)},
    }
    if not chosen.numpy_only:
        device = chosen.device or default_device()
        environments = chosen.environments or (8192 if device.startswith("cuda") else 64)
        result["versions"] |= {name: package_version(name) for name in ("warp-lang", "mujoco-warp")}
        result["warp"] = warp_seconds(environments, device, chosen.repeats)
    return result


def measured(chosen: argparse.Namespace) -> dict[str, Any]:
    """``measure`` with a sign of life on stderr."""
    with Console(stderr=True).status("measuring"):
        return measure(chosen)


def show(result: dict[str, Any]) -> None:
    """Two small tables."""
    console = Console(highlight=False)
    table = Table("model", "milliseconds", title=f"{result['numpy']['points']:,} envelope points in NumPy")
    for model, seconds in result["numpy"]["seconds"].items():
        table.add_row(model, f"{1e3 * seconds:.1f}")
    console.print(table)
    if "warp" not in result:
        return
    warp = result["warp"]
    title = f"{warp['environments']} environments x {warp['joints']} joints on {warp['device']}"
    table = Table("before each physics substep", "microseconds", "share of the substep", title=title)
    for name, seconds in warp["law_s"].items():
        table.add_row(name, f"{1e6 * seconds:.1f}", f"{100 * warp['share_of_substep'][name]:.2f} %")
    table.add_row("(the physics substep)", f"{1e6 * warp['physics_substep_s']:.1f}", "")
    console.print(table)


if __name__ == "__main__":
    sys.exit(answer(parse, measured, show))
