"""What the motor law costs in NumPy.

    python benchmarks/motor_law.py --json

Times ``torque_limits`` on ``--points`` speeds over all four quadrants; the median of ``--repeats`` samples.
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
from sprintlab.motors import MOTOR_MODELS, load_library_motor, torque_limits


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


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """The command line, checked."""
    parser = argparse.ArgumentParser(description="What the motor law costs.")
    parser.add_argument("--points", type=int, default=1_000_000, help="envelope points in NumPy")
    parser.add_argument("--repeats", type=int, default=15, help="samples of each number")
    parser.add_argument("--output", type=Path, help="write the JSON here")
    parser.add_argument("--json", action="store_true", help="print JSON only")
    chosen = parser.parse_args(arguments)
    check_range("points", chosen.points, 1, 10**8)
    check_range("repeats", chosen.repeats, 1, 10**4)
    return chosen


def measure(chosen: argparse.Namespace) -> dict[str, Any]:
    """Everything, ready for JSON."""
    return {
        "command": shlex.join(["python", *sys.argv]),
        "python": platform.python_version(),
        "machine": platform.machine(),
        "versions": {name: package_version(name) for name in ("numpy", "sprintlab")},
        "numpy": {"points": chosen.points, "seconds": numpy_seconds(chosen.points, chosen.repeats)},
    }


def measured(chosen: argparse.Namespace) -> dict[str, Any]:
    """``measure`` with a sign of life on stderr."""
    with Console(stderr=True).status("measuring"):
        return measure(chosen)


def show(result: dict[str, Any]) -> None:
    """One small table."""
    console = Console(highlight=False)
    table = Table("model", "milliseconds", title=f"{result['numpy']['points']:,} envelope points in NumPy")
    for model, seconds in result["numpy"]["seconds"].items():
        table.add_row(model, f"{1e3 * seconds:.1f}")
    console.print(table)


if __name__ == "__main__":
    sys.exit(answer(parse, measured, show))
