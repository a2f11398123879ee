"""Latency of the controller: policy step, loop, jitter, with a simulated robot in a process of its own.

    python benchmarks/controller_latency.py --minutes 10 --output latency.json
    python benchmarks/controller_latency.py --minutes 0.15 --cores 1   # a small computer; then --cores 2

The robot runs at ``--speed`` in real time behind shared memory; the controller is the one of ``sprintlab
run`` with its default thresholds, and its run is the measurement. Both processes ask for real-time priority,
as on a robot, unless ``--no-real-time``. Ends with 1 if the controller did not bring the robot down in good
order.

With ``--cores`` one process on that many cores steps the controller and, in between, the robot: what a step
takes, without a clock that anything could be late for.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import multiprocessing
import os
import platform
import sys
import time
from pathlib import Path
from typing import Any

from harness import circumstances
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from sprintlab.control import Policy, load_policy, shipped_policy
from sprintlab.core.files import atomic_write_json
from sprintlab.deployment.bus import BusError, open_bus, open_endpoint
from sprintlab.deployment.controller import Controller, LoopOptions, LoopReport, Mode, run_loop
from sprintlab.deployment.controller.realtime import real_time
from sprintlab.deployment.interface import PositionFix, RobotState
from sprintlab.deployment.simulator import PaceOptions, SimulatedWorld, SimulatorOptions, run_simulator
from sprintlab.deployment.sources import SprintSource
from sprintlab.robots import RobotDescription, load_robot

ROBOT_PRIORITY = 40
CONTROLLER_PRIORITY = 50
TO_RUN = 30.0  # [s] in which the robot has stood up and runs
PACKAGES = ("sprintlab", "numpy", "onnxruntime", "mujoco", "msgspec")


def _policy_and_robot() -> tuple[Policy, RobotDescription]:
    """The standard policy and the robot that its contract names."""
    policy = load_policy(shipped_policy())
    return policy, load_robot(policy.contract.robot_name)


def be_a_robot(address: str, urgent: bool, results: Any) -> None:
    """The robot's process: until the controller has left."""
    world = SimulatedWorld(_policy_and_robot()[1], SimulatorOptions())
    endpoint = open_endpoint(address)
    try:
        with real_time(ROBOT_PRIORITY if urgent else None):
            report = run_simulator(world, endpoint, PaceOptions(end_with_controller=True))
    finally:
        endpoint.close()
    results.put(report.to_dict())


def measure(minutes: float, speed: float, urgent: bool) -> dict[str, Any]:
    """Run the robot for some minutes; everything that was measured."""
    address = f"shm://latency-{os.getpid()}"
    context = multiprocessing.get_context("spawn")
    results = context.Queue()
    robot = context.Process(target=be_a_robot, args=(address, urgent, results))
    robot.start()
    load = os.getloadavg()
    report, controller = drive(address, minutes, speed, urgent)
    simulated = results.get(timeout=60.0)
    robot.join(timeout=10.0)
    return {
        **surroundings(load),
        "real_time_asked_for": urgent,
        "speed": speed,
        "faults": {fault.value: count for fault, count in controller.fault_counts.items()},
        "controller": report.to_dict(),
        "robot": {
            name: simulated[name]
            for name in (
                "simulated_time",
                "distance",
                "fall_reason",
                "watchdog_trips",
                "late_steps",
                "given_up",
            )
        },
    }


def surroundings(load: tuple[float, float, float]) -> dict[str, Any]:
    """When, with what, on what and beside how much other work."""
    policy = shipped_policy()
    return {
        **circumstances(PACKAGES),
        "policy": {"name": policy.stem, "sha256": hashlib.sha256(policy.read_bytes()).hexdigest()},
        "processor": processor(),
        "cores": len(os.sched_getaffinity(0)),
        "load_average": {"start": load, "end": os.getloadavg()},
    }


def measure_in_one_process(minutes: float, speed: float, urgent: bool, cores: int) -> dict[str, Any]:
    """Steps of a run on some cores, the robot simulated between them; everything that was measured."""
    load = os.getloadavg()
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:cores])
    policy, robot = _policy_and_robot()
    world = SimulatedWorld(robot, SimulatorOptions())
    controller = Controller(policy, robot, SprintSource(speed, distance=1e9, pace=False))
    report = LoopReport()
    with real_time(CONTROLLER_PRIORITY if urgent else None) as grant:
        report.grant = grant
        longest = 60.0 * minutes + TO_RUN
        while report.duration < 60.0 * minutes and world.time < longest and controller.mode is not Mode.STOP:
            step(world, controller, report)
    report.end = controller.stop_reason or controller.mode.value
    return {
        **surroundings(load),
        "real_time_asked_for": urgent,
        "speed": speed,
        "faults": {fault.value: count for fault, count in controller.fault_counts.items()},
        "controller": report.to_dict(),
    }


def step(world: SimulatedWorld, controller: Controller, report: LoopReport) -> None:
    """One millisecond of both; a step counts once the policy runs."""
    messages = world.messages(round(1e9 * world.time))
    states = [message for message in messages if isinstance(message, RobotState)]
    fixes = [message for message in messages if isinstance(message, PositionFix)]
    tick = controller.step(round(1e9 * world.time), states, fixes[-1] if fixes else None)
    world.hand_over(tick.command)
    world.step()
    if controller.mode is Mode.RUN:
        report.steps += 1
        report.duration += 1e-3
        report.compute.add(tick.compute_time)
        if tick.policy_step:
            report.policy_steps += 1
            report.policy.add(controller.policy_time)


def drive(address: str, minutes: float, speed: float, urgent: bool) -> tuple[LoopReport, Controller]:
    """The controller's side of ``measure``."""
    policy, robot = _policy_and_robot()
    source = SprintSource(speed, distance=1e9, pace=False)
    controller = Controller(policy, robot, source)
    options = LoopOptions(priority=CONTROLLER_PRIORITY if urgent else None, duration=60.0 * minutes)
    bus = wait_for_robot(address, controller.session)
    try:
        with Progress(console=Console(stderr=True), disable=not sys.stderr.isatty()) as progress:
            task = progress.add_task("running", total=60.0 * minutes)
            last = [0.0]

            def status(controller: Controller, report: LoopReport) -> None:
                if report.duration - last[0] >= 10.0:  # seldom: drawing takes milliseconds of this very loop
                    last[0] = report.duration
                    progress.update(task, completed=report.duration)

            report = run_loop(controller, bus, options, status=status if sys.stderr.isatty() else quiet)
    finally:
        bus.close()
    return report, controller


def quiet(controller: Controller, report: LoopReport) -> None:
    """Show nothing."""


def wait_for_robot(address: str, session: int) -> Any:
    """The bus, once the robot is on it."""
    deadline = time.monotonic() + 60.0
    while True:
        try:
            return open_bus(address, session=session)
        except BusError:
            if time.monotonic() > deadline:
                raise
            time.sleep(0.1)


def processor() -> str:
    """The processor's name, as Linux tells it."""
    path = Path("/proc/cpuinfo")
    lines = path.read_text().splitlines() if path.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


def show(result: dict[str, Any]) -> None:
    """Print the table."""
    columns = ("p50", "p90", "p99", "p99.9", "max")
    table = Table("latency [µs]", *columns, box=None)
    for name, values in result["controller"]["microseconds"].items():
        numbers = ["-" if values[column] is None else f"{values[column]:.0f}" for column in columns]
        table.add_row(name.replace("_", " "), *numbers)
    console, controller = Console(width=110), result["controller"]
    console.print(table)
    console.print(
        f"{controller['duration']:.0f} s, {controller['steps']} steps, "
        f"{controller['deadline_misses']} deadline misses, priority {controller['priority']}"
    )
    console.print(f"memory locked: {controller['memory_locked']}, ended: {controller['end']}")
    console.print(f"faults: {result['faults'] or 'none'}")


def main() -> int:
    """Measure and report."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--minutes", type=float, default=10.0, help="duration of the run")
    parser.add_argument("--speed", type=float, default=6.0, help="commanded speed [m/s]")
    parser.add_argument("--cores", type=int, help="one process on so many cores, not two in real time")
    parser.add_argument("--no-real-time", action="store_true", help="keep the normal scheduler")
    parser.add_argument("--output", type=Path, help="also write the JSON here")
    parser.add_argument("--json", action="store_true", help="print JSON only")
    given = parser.parse_args()
    if given.minutes <= 0.0 or not 0.0 < given.speed <= 12.0:
        parser.error("--minutes must be above 0, --speed above 0 and at most 12")
    if given.cores is not None and not 1 <= given.cores <= len(os.sched_getaffinity(0)):
        parser.error(f"--cores must be from 1 to the {len(os.sched_getaffinity(0))} of this machine")
    if given.cores is None:
        result = measure(given.minutes, given.speed, not given.no_real_time)
    else:
        result = measure_in_one_process(given.minutes, given.speed, not given.no_real_time, given.cores)
    if given.output is not None:
        atomic_write_json(given.output, result)
    if given.json:
        print(json.dumps(result, indent=2))
    else:
        show(result)
    return 0 if result["controller"]["end"] == ("passive" if given.cores is None else "run") else 1


if __name__ == "__main__":
    sys.exit(main())
