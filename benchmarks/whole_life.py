"""How often a robot's whole life over the bus succeeds: stand up, run, lie down, stand up again, run again.

    python benchmarks/whole_life.py --policies sprint go1-sprint --speeds 2 4 8 --seeds 10

Controller and simulated robot step together in one process. A seed draws friction (0.7 to 1.0), payload
(+-1 kg), initial joint noise (0.1 rad) and the sensors' noise.
"""

from __future__ import annotations

import argparse
import itertools
import math
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from harness import EVALUATION_PACKAGES, answer, circumstances
from rich.console import Console
from rich.progress import track
from rich.table import Table

from sprintlab.commands import heading_command
from sprintlab.control import load_policy, shipped_policy
from sprintlab.core.checks import check_range
from sprintlab.deployment.controller import Controller
from sprintlab.deployment.interface import OperatorCommand, Request, SourceView
from sprintlab.deployment.simulator import SimulatedRobot, SimulatorOptions
from sprintlab.deployment.simulator.options import TYPICAL_NOISE
from sprintlab.plant import TrialSettings
from sprintlab.robots import load_robot

MILLISECOND = 1_000_000  # ns
SECOND_RUN = 2.0  # m/s


class Operator:
    """Asks for what it is told to, straight on."""

    def __init__(self) -> None:
        self.request, self.speed, self.sequence = Request.NONE, 0.0, 0

    def read(self, view: SourceView) -> OperatorCommand:
        self.sequence += 1
        turn = heading_command(view.heading, view.lateral_offset, self.speed) if view.mode == "run" else 0.0
        velocity = np.array([self.speed, 0.0, float(turn)])
        return OperatorCommand(sequence=self.sequence, timestamp=0, velocity=velocity, request=self.request)

    def close(self) -> None:
        """Nothing to let go of."""


class LifeEnds(Exception):
    """The robot fell, stopped, or did not get where it was asked to."""


@dataclass
class Life:
    """One robot with its controller; ``tilt`` [degrees] and ``sinking`` [m/s] are the greatest so far."""

    robot: SimulatedRobot
    controller: Controller
    operator: Operator
    now: int = 1_000_000_000
    tilt: float = 0.0
    sinking: float = 0.0

    def step(self) -> str:
        tick = self.controller.step(self.now, [self.robot.state(self.now)], self.robot.fix(self.now))
        self.robot.accept(tick.command)
        self.robot.step()
        self.now += MILLISECOND
        data = self.robot.plant.data
        x, y = data.qpos[4:6].tolist()
        self.tilt = max(self.tilt, math.degrees(math.acos(max(-1.0, 1.0 - 2.0 * (x * x + y * y)))))
        self.sinking = max(self.sinking, -float(data.qvel[2]))
        if self.robot.fall_reason or tick.mode == "stop":
            raise LifeEnds(self.robot.fall_reason or self.controller.stop_reason)
        return tick.mode

    def run(self, seconds: float) -> None:
        for _ in range(round(1000 * seconds)):
            self.step()

    def ask(self, request: Request, mode: str, seconds: float, speed: float = 0.0) -> None:
        self.operator.request, self.operator.speed = request, speed
        for _ in range(round(1000 * seconds)):
            if self.step() == mode:
                return
        raise LifeEnds(f"{mode} not reached")


def live(task: tuple[str, float, int]) -> tuple[str, float, float]:
    """How one life ended (empty: well), and tilt [degrees] and sinking speed [m/s] on the way down."""
    name, speed, seed = task
    policy, random, operator = (
        load_policy(shipped_policy(name)),
        np.random.default_rng(1000 + seed),
        Operator(),
    )
    robot = load_robot(policy.contract.robot_name)
    friction, payload = float(random.uniform(0.7, 1.0)), float(random.uniform(-1.0, 1.0))
    trial = TrialSettings(seed=seed, joint_noise=0.1, friction=friction, payload=payload)
    simulated = SimulatedRobot(robot, SimulatorOptions(trial=trial, noise=TYPICAL_NOISE, seed=seed))
    life = Life(simulated, Controller(policy, robot, operator), operator)
    down = (0.0, 0.0)
    try:
        life.ask(Request.STAND, "stand", 6.0)
        life.run(0.6)
        life.ask(Request.RUN, "run", 3.0, speed)
        life.run(speed / 4.0 + 1.0)
        life.ask(Request.LIE_DOWN, "stand", 10.0)
        life.tilt = life.sinking = 0.0
        life.ask(Request.LIE_DOWN, "passive", 12.0)
        down = (life.tilt, life.sinking)
        life.ask(Request.STAND, "stand", 6.0)
        life.run(0.6)
        life.ask(Request.RUN, "run", 2.0, SECOND_RUN)
        life.run(2.0)
        return ("" if life.robot.plant.data.qvel[0] > 0.5 * SECOND_RUN else "second run too slow", *down)
    except LifeEnds as end:
        return f"{life.controller.mode.value}: {end}", *down


def summary(name: str, speed: float, ends: Sequence[tuple[str, float, float]]) -> dict[str, Any]:
    """The lives of one policy at one speed."""
    return {
        "policy": name,
        "speed_m_s": speed,
        "lives": len(ends),
        "lived": sum(not reason for reason, _, _ in ends),
        "greatest_tilt_deg": max(tilt for _, tilt, _ in ends),
        "greatest_sinking_m_s": max(sinking for _, _, sinking in ends),
        "failures": sorted({reason for reason, _, _ in ends if reason}),
    }


def measure(chosen: argparse.Namespace) -> dict[str, Any]:
    """Every policy at every speed, life after life."""
    cases = list(itertools.product(chosen.policies, chosen.speeds))
    tasks = [(name, speed, seed) for name, speed in cases for seed in range(chosen.seeds)]
    with ProcessPoolExecutor(chosen.workers) as pool:
        console = Console(stderr=True)
        ends = list(track(pool.map(live, tasks), "lives", total=len(tasks), transient=True, console=console))
    groups = [ends[first : first + chosen.seeds] for first in range(0, len(ends), chosen.seeds)]
    rows = [summary(*case, group) for case, group in zip(cases, groups, strict=True)]
    return {**circumstances(EVALUATION_PACKAGES), "rows": rows}


def show(result: dict[str, Any]) -> None:
    """A table of the rows."""
    table = Table("policy", "run [m/s]", "lived", "tilt [deg]", "down [m/s]", "what failed")
    for row in result["rows"]:
        numbers = (f"{row['greatest_tilt_deg']:.1f}", f"{row['greatest_sinking_m_s']:.2f}")
        lived = f"{row['lived']} of {row['lives']}"
        table.add_row(
            row["policy"], f"{row['speed_m_s']:g}", lived, *numbers, "; ".join(row["failures"]) or "-"
        )
    Console().print(table)


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """The command line, checked."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--policies", nargs="+", default=["sprint"], help="shipped policies")
    parser.add_argument("--speeds", nargs="+", type=float, default=[2.0, 4.0, 8.0], help="of the run [m/s]")
    parser.add_argument("--seeds", type=int, default=10, help="lives for each policy and speed")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--output", type=Path, help="JSON file")
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    chosen = parser.parse_args(arguments)
    for name in chosen.policies:
        shipped_policy(name)
    for speed in chosen.speeds:
        check_range("speeds", speed, 0.5, 20.0, "m/s")
    check_range("seeds", chosen.seeds, 1, 10**4)
    check_range("workers", chosen.workers, 1, 10**3)
    return chosen


if __name__ == "__main__":
    sys.exit(answer(parse, measure, show))
