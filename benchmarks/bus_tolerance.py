"""What delay, jitter and loss on the robot's bus cost: speed over 100 m and falls.

    python benchmarks/bus_tolerance.py --output results/deployment/bus_tolerance.json

Controller and simulated robot run in one process, step by step, so that the result depends on nothing but the
link. Every condition holds for both directions; "delay" is the round trip, half of it each way. A run ends
at the 100th metre or with a fall; the file is written anew whenever a condition is complete.
"""

from __future__ import annotations

import argparse
import os
import platform
import statistics
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from rich.progress import track

from sprintlab.control import load_policy, shipped_policy
from sprintlab.core.files import atomic_write_json
from sprintlab.deployment.controller import Controller
from sprintlab.deployment.messages import PositionFix, RobotState
from sprintlab.deployment.operators import SprintSource
from sprintlab.deployment.simulator import TYPICAL_NOISE, LinkOptions, SimulatedWorld, SimulatorOptions
from sprintlab.plant import TrialSettings
from sprintlab.robots import load_robot

LONGEST = 60.0  # [s] of simulated time


@dataclass(frozen=True, kw_only=True)
class Condition:
    """A link: round-trip delay [ms], greatest additional delay each way [ms], loss each way [%]."""

    delay_ms: float = 0.0
    jitter_ms: float = 0.0
    loss_percent: float = 0.0

    def link(self) -> LinkOptions:
        return LinkOptions(
            delay=0.5e-3 * self.delay_ms, jitter=1e-3 * self.jitter_ms, loss=0.01 * self.loss_percent
        )


CONDITIONS = (
    *(Condition(delay_ms=delay) for delay in (0, 2, 4, 6, 8, 10, 15, 20)),
    *(Condition(jitter_ms=jitter) for jitter in (2, 8)),
    *(Condition(loss_percent=loss) for loss in (5, 20, 50)),
    Condition(delay_ms=2, jitter_ms=1, loss_percent=5),
)


def run_sprint(condition: Condition, seed: int, top_speed: float) -> dict[str, Any]:
    """One self-paced 100 m; friction and payload of the trial come from the seed."""
    random = np.random.default_rng(seed)
    trial = TrialSettings(
        seed=seed, friction=float(random.uniform(0.7, 1.0)), payload=float(random.uniform(-1.0, 1.0))
    )
    options = SimulatorOptions(trial=trial, noise=1.0, seed=seed)
    policy = load_policy(shipped_policy())
    robot = load_robot(policy.contract.robot_name)
    world = SimulatedWorld(robot, options, condition.link())
    source = SprintSource(top_speed)
    controller = Controller(policy, robot, source)
    return _drive(world, controller, source)


def _drive(world: SimulatedWorld, controller: Controller, source: SprintSource) -> dict[str, Any]:
    way: list[float] = []
    while world.time < LONGEST and controller.mode.value != "stop" and source.finish_time is None:
        states, fix = _received(world)
        world.hand_over(controller.step(round(1e9 * world.time), states, fix).command)
        world.step()
        if controller.mode.value == "run":
            way.append(float(world.robot.plant.data.qpos[0]))
        if world.robot.fall_reason:
            break
    fell = bool(world.robot.fall_reason) or controller.mode.value == "stop"
    finished = source.finish_time is not None
    return {
        "fell": fell,
        "cause": controller.stop_reason or world.robot.fall_reason,
        "time_s": source.finish_time - 1.0 if finished else None,
        "held_speed_m_s": (way[-1] - way[-2001]) / 2.0 if finished else None,
        "distance_m": round(way[-1], 2) if way else 0.0,
        "watchdog_trips": world.robot.watchdog_trips,
    }


def _received(world: SimulatedWorld) -> tuple[list[RobotState], PositionFix | None]:
    states: list[RobotState] = []
    fix = None
    for message in world.messages(round(1e9 * world.time)):
        if isinstance(message, RobotState):
            states.append(message)
        else:
            fix = message
    return states, fix


def summary(condition: Condition, runs: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """One row of the table."""
    times = [run["time_s"] for run in runs if run["time_s"] is not None and not run["fell"]]
    speeds = [run["held_speed_m_s"] for run in runs if run["held_speed_m_s"] is not None and not run["fell"]]
    return {
        **asdict(condition),
        "runs": len(runs),
        "falls": sum(run["fell"] for run in runs),
        "unfinished": sum(run["time_s"] is None and not run["fell"] for run in runs),
        "time_100m_s": statistics.mean(times) if times else None,
        "held_speed_m_s": statistics.mean(speeds) if speeds else None,
        "watchdog_trips": sum(run["watchdog_trips"] for run in runs),
        "causes": sorted({run["cause"] for run in runs if run["fell"]}),
    }


def main() -> None:
    """Run every condition and write the file."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--output", type=Path, default=Path("results/deployment/bus_tolerance.json"))
    parser.add_argument("--trials", type=int, default=3, help="seeded runs a condition")
    parser.add_argument("--top-speed", type=float, default=12.0, help="highest command [m/s]")
    parser.add_argument("--workers", type=int, default=None, help="processes; one a core when left out")
    arguments = parser.parse_args()
    results: dict[Condition, list[dict[str, Any]]] = {condition: [] for condition in CONDITIONS}
    with ProcessPoolExecutor(arguments.workers) as pool:
        jobs = {
            pool.submit(run_sprint, condition, seed, arguments.top_speed): condition
            for condition in CONDITIONS
            for seed in range(arguments.trials)
        }
        for job in track(as_completed(jobs), description="running", total=len(jobs), transient=True):
            results[jobs[job]].append(job.result())
            rows = [summary(*item) for item in results.items() if len(item[1]) == arguments.trials]
            if len(results[jobs[job]]) == arguments.trials:
                _write(arguments, rows)


def _write(arguments: argparse.Namespace, rows: list[dict[str, Any]]) -> None:
    result = {
        "policy": "sprint",
        "top_speed_m_s": arguments.top_speed,
        "noise": TYPICAL_NOISE,
        "machine": f"{platform.machine()}, {os.cpu_count()} cores",
        "versions": {name: metadata.version(name) for name in ("mujoco", "numpy", "onnxruntime")},
        "rows": rows,
    }
    atomic_write_json(arguments.output, result)


if __name__ == "__main__":
    main()
