"""Judge the policies of several trainings alike in the plant, and name the median one.

    python tools/judge_seeds.py runs/seed-*/policy.onnx --output results/sprint/seeds.json

Each policy runs the profile at several speeds, a 100 m race, a slope, with late commands and weak motors,
turns, and sprints with everything randomized. One row per policy goes to the screen and into the file, in
which the policies are in the order of the speed that they hold when asked for the top one. A robot of yours
is looked for in ``./robots``; ``--robot`` says another place.
"""

from __future__ import annotations

import argparse
import json
import math
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import track

from sprintlab.api.policies import known_robot
from sprintlab.api.results import table
from sprintlab.control import Policy, load_policy
from sprintlab.core.files import atomic_write_json
from sprintlab.core.json_values import json_ready
from sprintlab.core.text import number
from sprintlab.evaluation.audit import CLOCK_ITEM, audit_trials
from sprintlab.evaluation.pool import WorkerProcesses
from sprintlab.evaluation.protocol import JOINT_NOISE, ProtocolSettings
from sprintlab.evaluation.results import TrialMetrics
from sprintlab.evaluation.robustness import ALL, draw_request
from sprintlab.evaluation.sweep import Case, Run, run_case
from sprintlab.evaluation.trial import TrialRequest, run_trial
from sprintlab.evaluation.turning import Turn, largest_yaw_rate
from sprintlab.plant import PlantOptions, TrialSettings
from sprintlab.plant.ground import Ground
from sprintlab.robots import RobotDescription, load_robot

SHARES = (2 / 13, 5 / 13, 8 / 13, 12 / 13, 1.0, 14 / 13)
"""Speeds of the profile, over the top speed."""
TURNING_SHARES = (0.0, 2 / 13, 6 / 13, 10 / 13, 12 / 13)
SMALL_TURN, TURN = 0.05, 4.0
"""Yaw rate of a small turn [rad/s] and duration of every turn [s]."""
BACKWARD = (-1.0, -2.0)


@dataclass(frozen=True, kw_only=True)
class Task:
    """One run of one policy; ``group`` says what it tells."""

    policy: str
    robot: str | None
    group: str
    case: Case


@lru_cache(maxsize=4)
def opened(path: str, robot: str | None) -> tuple[Policy, RobotDescription]:
    """Policy and robot (that of the contract for ``None``), once per process."""
    policy = load_policy(path)
    return policy, load_robot(robot or known_robot(policy.contract.robot_name, Path(path).name))


def run(task: Task) -> TrialMetrics | Run:
    """What a worker process does."""
    policy, robot = opened(task.policy, task.robot)
    if task.group in ("profile", "slope", "late", "weak"):
        return run_trial(policy, robot, task.case.request).metrics
    return run_case(policy, robot, task.case)


def tasks(path: str, robot: str | None, top: float, trials: int, sprints: int) -> Iterator[Task]:
    """Every run of one policy."""
    protocol = ProtocolSettings(trials=trials, required=1)

    def task(group: str, request: TrialRequest) -> Task:
        return Task(policy=path, robot=robot, group=group, case=Case(group=group, request=request))

    for share in SHARES:
        for request in protocol.requests(share * top, self_paced=False):
            yield task("profile", replace(request, keep_trajectory=False))
    first = replace(protocol.requests(top, self_paced=False)[0], keep_trajectory=False)
    yield task("slope", replace(first, plant=PlantOptions(ground=Ground(slope=0.05))))
    yield task("late", replace(first, settings=replace(first.settings, delay=0.015)))
    yield task("weak", replace(first, settings=replace(first.settings, strength=0.9)))
    for seed in range(trials):
        settings = TrialSettings(seed=seed, joint_noise=JOINT_NOISE)
        yield task("100 m", TrialRequest(top_speed=top, distance=100.0, settings=settings))
    bus = opened(path, robot)[1].bus_voltage
    for seed in range(sprints):
        yield task("sprints", draw_request(1000 + seed, ALL, top_speed=top, bus_voltage=bus))
    for turn in turns(top):
        yield Task(policy=path, robot=robot, group="turns", case=turn.case())
    for speed in BACKWARD:
        yield Task(policy=path, robot=robot, group="backward", case=Turn(speed, 0.0, TURN).case())


def turns(top: float) -> list[Turn]:
    """Small ones, and up to half of what friction allows, to both sides."""
    found = []
    for share in TURNING_SHARES:
        speed = share * top
        largest = largest_yaw_rate(speed)
        for rate in (SMALL_TURN, 0.25 * largest, 0.5 * largest):
            found += [Turn(speed, side * rate, TURN) for side in (1.0, -1.0)]
    return found


def profile_row(found: Sequence[TrialMetrics]) -> dict[str, Any]:
    """One speed of the profile: medians, and what of the audit fails."""
    audit = audit_trials(found)
    return {
        "held_speed_m_s": float(np.median([trial.held_speed for trial in found])),
        "cost_of_transport": float(np.median([trial.cost_of_transport for trial in found])),
        "failed": [item.name for item in audit.failed if item.name != CLOCK_ITEM],
    }


def row_of(path: str, top: float, pairs: Sequence[tuple[Task, TrialMetrics | Run]]) -> dict[str, Any]:
    """Everything that the runs of one policy tell."""
    groups: dict[str, list[Any]] = defaultdict(list)
    profile: dict[float, list[TrialMetrics]] = defaultdict(list)
    for task, found in pairs:
        groups[task.group].append(found)
        if task.group == "profile" and isinstance(found, TrialMetrics):
            profile[task.case.request.top_speed].append(found)
    speeds = {f"{speed:g}": profile_row(found) for speed, found in profile.items()}
    passed = [row["held_speed_m_s"] for row in speeds.values() if not row["failed"]]
    upright = [each.held_speed_m_s for each in groups["sprints"] if each.upright]
    gains = [
        (each.yaw_rate_rad_s or 0.0) / turn.yaw_rate
        for each, turn in zip(groups["turns"], turns(top), strict=True)
    ]
    left_lane = [each.left_lane for each in groups["100 m"]]
    lane = ["lane"] if np.median(left_lane) > 0.0 else []
    return {
        "policy": path,
        "held_speed_m_s": speeds[f"{top:g}"]["held_speed_m_s"],
        "failed": [*speeds[f"{top:g}"]["failed"], *lane],
        "best_passed_m_s": max(passed, default=None),
        "speeds": speeds,
        "sprint_time_s": [each.time_s for each in groups["100 m"]],
        "sprint_left_lane": left_lane,
        **{f"{name}_held_m_s": groups[name][0].held_speed for name in ("slope", "late", "weak")},
        "backward_m_s": [each.held_speed_m_s for each in groups["backward"]],
        "turn_gain": gains,
        "turn_falls": sum(not each.upright for each in groups["turns"]),
        "sprints_upright": len(upright) / max(1, len(groups["sprints"])),
        "sprints_in_lane": float(np.mean([not each.left_lane for each in groups["sprints"]])),
        "sprints_median_m_s": float(np.median(upright)) if upright else None,
        "sprints_slow_m_s": float(np.quantile(upright, 0.05)) if upright else None,
    }


def shown(rows: Sequence[dict[str, Any]]) -> Any:
    """The rows as a table."""

    def cell(value: float | None) -> str:
        return number(math.nan if value is None else value)

    columns = ("policy", "held", "fails", "best passed", "100 m", "slope", "late", "weak", "turns", "sprints")
    cells = (
        (
            Path(row["policy"]).parent.name or row["policy"],
            cell(row["held_speed_m_s"]),
            ", ".join(row["failed"]) or "nothing",
            cell(row["best_passed_m_s"]),
            " ".join(cell(each) for each in row["sprint_time_s"]),
            *(cell(row[f"{name}_held_m_s"]) for name in ("slope", "late", "weak")),
            " to ".join(number(100 * pick(row["turn_gain"]), 0) for pick in (min, max)) + " %",
            f"{100 * row['sprints_upright']:.0f} %, {cell(row['sprints_median_m_s'])}, "
            f"{cell(row['sprints_slow_m_s'])}",
        )
        for row in rows
    )
    return table("Seeds, speeds in m/s", *columns, numbers=columns[1:2], rows=cells)


def main() -> None:
    """Judge, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("policies", nargs="+", type=Path)
    parser.add_argument(
        "--robot", help="name, folder or table of the robot; that of the policies when left out"
    )
    parser.add_argument("--top", type=float, default=13.0, help="speed asked for [m/s]")
    parser.add_argument("--trials", type=int, default=3, help="at each speed, and 100 m races")
    parser.add_argument("--sprints", type=int, default=24, help="with everything randomized")
    parser.add_argument("--workers", type=int, help="processes; one a core when left out")
    parser.add_argument("--output", type=Path)
    parser.add_argument("--json", action="store_true")
    chosen = parser.parse_args()
    paths = [str(path) for path in chosen.policies]
    counts = (chosen.top, chosen.trials, chosen.sprints)
    every = [task for path in paths for task in tasks(path, chosen.robot, *counts)]
    console = Console(stderr=True)
    with WorkerProcesses(chosen.workers) as processes:
        found = list(track(processes.map(run, every), "judging", len(every), console=console))
    pairs = list(zip(every, found, strict=True))
    rows = [row_of(path, chosen.top, [pair for pair in pairs if pair[0].policy == path]) for path in paths]
    rows = json_ready(sorted(rows, key=lambda row: np.nan_to_num(row["held_speed_m_s"])))
    if chosen.output is not None:
        atomic_write_json(chosen.output, rows)
    if chosen.json:
        print(json.dumps(rows, indent=2))
    else:
        Console(width=160).print(shown(rows), f"median: {rows[len(rows) // 2]['policy']}", sep="\n")


if __name__ == "__main__":
    main()
