"""What the motor law costs in NumPy: a million envelope points over all four quadrants, on one thread.

python benchmarks/motor_law.py
"""

from __future__ import annotations

import argparse
import json
import platform
import statistics
import time
from pathlib import Path

import numpy as np

from sprintlab.motors import MOTOR_MODELS, load_library_motor, torque_limits

RESULT = Path(__file__).resolve().parents[1] / "results" / "throughput" / "motor_law.json"
POINTS, REPEATS = 1_000_000, 15


def median_seconds(model: str) -> float:
    """Median duration of ``POINTS`` evaluations [s]."""
    actuator = load_library_motor("mit-humanoid-u12")
    speed = np.random.default_rng(0).uniform(-600.0, 600.0, POINTS)
    samples: list[float] = []
    for _ in range(REPEATS):
        started = time.perf_counter()
        torque_limits(actuator.motor, speed, actuator.bus_voltage, model)
        samples.append(time.perf_counter() - started)
    return statistics.median(samples)


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__).parse_args()
    found = {
        "python": platform.python_version(),
        "machine": platform.machine(),
        "numpy": np.__version__,
        "points": POINTS,
        "seconds": {model: median_seconds(model) for model in MOTOR_MODELS},
    }
    RESULT.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")
    print(json.dumps(found, indent=2))
