"""Calibrate the BP2 surrogate: its speed limits over motor, gears, spring and leg, before any training.

    python recipes/calibrate_bp2.py                    about 20 CPU minutes; goes on where it stopped

Every cell is a robot of the family ``sprintlab.robots.surrogate``. Its fastest stride of at most 5.5 Hz and a
duty of at least 0.12 is searched under three motor models: ``refined``, ``simplified-dc`` (no inductance) and
``square`` (peak torque at every speed). The grid is walked coarse to fine: few starts everywhere, many where
the rules may hold. All numbers land in one file, results/speed_limit/bp2.json.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from itertools import product
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
import tyro
from matplotlib.axes import Axes
from rich.progress import Progress

from sprintlab.core.files import atomic_write_text
from sprintlab.core.theme import LIGHT, axis_legend, save_figure, set_title, themed_figure
from sprintlab.motors import no_load_speed
from sprintlab.robots import RobotDescription
from sprintlab.robots.surrogate import EDITIONS, Surrogate, surrogate_robot
from sprintlab.speed_limit import (
    Fastest,
    Runner,
    SearchSettings,
    evaluate,
    fastest_stride,
    runner_from_robot,
    stride_facts,
)
from sprintlab.speed_limit.stride import GROUPS

MODELS = ("refined", "simplified-dc", "square")
SETTINGS = SearchSettings(max_stride=5.5, min_duty=0.12)
SCREEN_STARTS, FINE_STARTS = 1, 8
STACKS = (1.4, 1.6, 1.8, 2.0)
HIP_GEARS, KNEE_GEARS = (7.0, 7.5, 8.0, 8.5), (7.0, 8.0)
FINE = (
    "1.4/8/7/800/1",
    "1.4/8.25/7/800/1",
    "1.4/8.25/7.5/800/1",
    "1.5/8/7/800/1",
    "1.5/8.25/7/800/1",
    "1.6/7.75/7/800/1",
    "1.6/8/7/800/1",
    "1.6/8/7.5/800/1",
)
"""Where the coarse grid says that all rules may just hold."""
SPRINGS_AND_LEGS = (
    "1.4/8.25/7/500/1",
    "1.4/8.25/7/1200/1",
    "1.4/8.25/7/800/0.95",
    "1.4/8.25/7/800/1.05",
)
RESULT = Path("results/speed_limit/bp2.json")
POLICIES, FIGURE = Path("results/speed_limit/robots.json"), Path("docs/images/bp2-calibration.png")
REFINED, SIMPLIFIED_GAIN, SQUARE_GAIN = 13.2, 0.02, 0.09
COLORS = (*LIGHT.legs, LIGHT.second, LIGHT.speed, LIGHT.muted)
SCREENING = (
    "limits under MODELS of an earlier, wider walk; its gears lost torque in braking instead of gaining it, "
    "so that they lie 1 to 4 % low"
)
FACTS = ("frequency", "duty", "peak_force", "hip_full", "knee_full", "mechanical_power", "copper_loss")


@dataclass(frozen=True)
class Job:
    """One cell: a robot, how many starts, and strides of similar robots to begin with.

    Attributes:
        choice: the robot.
        starts: of every search.
        near: by motor model, strides as ``(speed, parameters)``.
        lift: also the limits without hip torque and without knee torque.
    """

    choice: Surrogate
    starts: int
    near: dict[str, list[tuple[float, list[float]]]]
    lift: bool = False


def key_of(choice: Surrogate) -> str:
    """``stack/hip gear/knee gear/spring/leg``."""
    return "/".join(
        f"{value:g}" for value in (choice.stack, choice.hip_gear, choice.knee_gear, choice.spring, choice.leg)
    )


def choice_of(key: str) -> Surrogate:
    """Inverse of ``key_of``."""
    stack, hip, knee, spring, leg = (float(word) for word in key.split("/"))
    return Surrogate(stack=stack, hip_gear=hip, knee_gear=knee, spring=spring, leg=leg)


def calibrate_cell(job: Job) -> dict[str, Any]:
    """Limits of one cell under the three models, each search begun at the last one's stride too."""
    begun, runner = process_time(), runner_from_robot(surrogate_robot(job.choice))
    settings = replace(SETTINGS, starts=job.starts)
    limits: dict[str, Any] = {}
    near: list[Fastest] = []
    for model in MODELS:
        known = [Fastest(speed=v, parameters=np.array(p)) for v, p in job.near.get(model, [])]
        under = replace(runner, motor_model=model)
        found = fastest_stride(under, settings, near=[*near, *known])
        near = [found]
        limits[model] = _limit(under, found)
    cell = {"starts": job.starts, "limits": limits, **joint_facts(surrogate_robot(job.choice))}
    if job.lift:
        refined = limits["refined"]
        best = Fastest(speed=refined["speed"], parameters=np.array(refined["stride"]))
        cell["without"] = {joint: _without(runner, joint, best) for joint in ("hip", "knee")}
    return {**cell, "cpu_s": round(process_time() - begun, 1)}


def _limit(runner: Runner, found: Fastest) -> dict[str, Any]:
    stride = evaluate(runner, found.parameters[None], found.speed)
    facts = asdict(stride_facts(runner, stride, found.speed))
    return {
        "speed": round(found.speed, 3),
        "found": [round(speed, 2) for speed in found.found],
        **{name: float(f"{facts[name]:.3g}") for name in FACTS},
        "stride": [float(f"{value:.5g}") for value in found.parameters],
    }


def _without(runner: Runner, joint: str, best: Fastest) -> float:
    """Limit without one joint's torque limit [m/s]."""
    kept = [group for group in GROUPS if not group.startswith(joint)]
    settings = replace(SETTINGS, starts=3)
    return round(fastest_stride(runner, settings, groups=kept, near=best, ceiling=2 * best.speed).speed, 3)


def joint_facts(robot: RobotDescription) -> dict[str, list[float]]:
    """What the joints of hip and knee can do: peak torque [N m] and no-load speed [rad/s]."""
    peak = runner_from_robot(robot).peak_torque
    speed = np.asarray(no_load_speed(robot.motors, robot.bus_voltage)) / np.asarray(robot.gear.ratio)
    return {
        "peak_torque": [round(float(v), 1) for v in peak],
        "no_load": [round(float(v), 2) for v in speed[1:3]],
    }


# --- the walk over the grid ---------------------------------------------------------------------------------


def distance(first: Surrogate, second: Surrogate) -> float:
    """How far two robots are from each other, in steps of the grid."""
    steps = (
        (first.stack - second.stack) / 0.2,
        (first.hip_gear - second.hip_gear) / 0.5,
        (first.knee_gear - second.knee_gear) / 0.75,
        np.log(first.spring / second.spring) / np.log(2.0),
        (first.leg - second.leg) / 0.05,
    )
    return float(np.linalg.norm(steps))


def neighbours(choice: Surrogate, cells: dict[str, Any], count: int) -> dict[str, Any]:
    """Strides of the nearest cells that are known, by motor model."""
    known = sorted(cells, key=lambda key: distance(choice, choice_of(key)))[:count]
    return {
        model: [(cells[key]["limits"][model][name] for name in ("speed", "stride")) for key in known]
        for model in MODELS
    }


def coarse() -> Iterator[Surrogate]:
    """The whole grid with the template's springs and legs."""
    for stack, hip, knee in product(STACKS, HIP_GEARS, KNEE_GEARS):
        yield Surrogate(stack=stack, hip_gear=hip, knee_gear=knee)


class Calibration:
    """Cells done so far, in a file that is written after each."""

    def __init__(self, path: Path, workers: int) -> None:
        self.path, self.workers = path, workers
        document = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
        self.cells: dict[str, Any] = document.get("cells", {})
        self.screening: dict[str, Any] = document.get("screening", {})

    def add(self, choices: Sequence[Surrogate], starts: int, lift: bool = False) -> None:
        """Search the cells that are not there yet with as many starts."""
        todo = [choice for choice in choices if self._missing(choice, starts, lift)]
        with ProcessPoolExecutor(self.workers) as pool, Progress() as progress:
            bar = progress.add_task(f"{starts} starts", total=len(todo))
            while todo:
                batch, todo = todo[: self.workers], todo[self.workers :]
                jobs = [self._job(choice, starts, lift) for choice in batch]
                for choice, cell in zip(batch, pool.map(calibrate_cell, jobs), strict=True):
                    self.cells[key_of(choice)] = cell
                    progress.advance(bar)
                self.write()

    def _missing(self, choice: Surrogate, starts: int, lift: bool) -> bool:
        cell = self.cells.get(key_of(choice), {"starts": 0})
        return cell["starts"] < starts or (lift and "without" not in cell)

    def _job(self, choice: Surrogate, starts: int, lift: bool) -> Job:
        near = neighbours(choice, self.cells, 1 if starts < FINE_STARTS else 3)
        plain = {model: [tuple(item) for item in items] for model, items in near.items()}
        return Job(choice, starts, plain, lift)

    def write(self) -> None:
        """The file, one line a cell."""
        lines = [
            f"{json.dumps(key)}: {json.dumps(self.cells[key], separators=(',', ':'))}"
            for key in sorted(self.cells)
        ]
        head = {
            "max_stride_hz": SETTINGS.max_stride,
            "min_duty": SETTINGS.min_duty,
            "cells are": "stack/hip gear/knee gear/spring [N m/rad]/leg length over 0.63 m",
            "cpu_s": round(sum(cell["cpu_s"] for cell in self.cells.values())),
        }
        head["screening is"] = SCREENING
        head["screening"] = self.screening
        text = json.dumps(head, indent=1)[:-2] + ',\n "cells": {\n' + ",\n".join(lines) + "\n}}\n"
        self.path.parent.mkdir(parents=True, exist_ok=True)
        atomic_write_text(self.path, text)


# --- rules and picture --------------------------------------------------------------------------------------


def rules(cell: dict[str, Any], mass: float = 36.5) -> dict[str, bool]:
    """Which rules of docs/speed-limit.md a cell meets."""
    refined, simplified, square = (cell["limits"][model]["speed"] for model in MODELS)
    without = cell.get("without")
    return {
        "refined limit": refined >= REFINED,
        "voltage binds": simplified >= (1.0 + SIMPLIFIED_GAIN) * refined
        and square >= (1.0 + SQUARE_GAIN) * refined,
        "hips stop it": without is None or without["hip"] > without["knee"],
        "joints": all(2.5 <= torque / mass <= 4.5 for torque in cell["peak_torque"])
        and all(26.0 <= speed <= 37.0 for speed in cell["no_load"]),
    }


def draw(cells: dict[str, Any], screening: dict[str, list[float]], path: Path) -> None:
    """The map and the policies of the package under the limits of their robots."""
    figure, axes = themed_figure(LIGHT, (12.0, 3.9), 1, 3)
    _draw_screening(axes[0], screening)
    _draw_map(axes[0], cells)
    _draw_gains(axes[1], cells)
    _draw_policies(axes[2])
    save_figure(path, figure, dpi=90)


def _rows(cells: dict[str, Any]) -> dict[float, list[tuple[float, dict[str, Any]]]]:
    """Cells with the knee gear, springs and legs of the choice: hip gear and cell, by stack."""
    rows: dict[float, list[tuple[float, dict[str, Any]]]] = {}
    for key in cells:
        choice = choice_of(key)
        if (choice.knee_gear, choice.spring, choice.leg) == (7.0, 800.0, 1.0):
            rows.setdefault(choice.stack, []).append((choice.hip_gear, cells[key]))
    return {stack: sorted(row, key=lambda item: item[0]) for stack, row in sorted(rows.items())}


def _draw_map(axes: Axes, cells: dict[str, Any]) -> None:
    for color, (stack, row) in zip(COLORS, _rows(cells).items(), strict=False):
        gears, speeds = [gear for gear, _ in row], [cell["limits"]["refined"]["speed"] for _, cell in row]
        axes.plot(gears, speeds, color=color, label=f"stack {stack:g}")
        for gear, cell in row:
            fill = color if all(rules(cell).values()) else "none"
            axes.plot(gear, cell["limits"]["refined"]["speed"], "o", color=color, mfc=fill)
    chosen = EDITIONS["bp2"]
    speed = cells[key_of(chosen)]["limits"]["refined"]["speed"]
    axes.plot(chosen.hip_gear, speed, "*", ms=15, color=LIGHT.foreground, label="bp2")
    axes.axhline(REFINED, color=LIGHT.muted, ls="--")
    axes.set(xlabel="gear ratio of the hip", ylabel="refined limit [m/s]")
    set_title(axes, "Limit by stack (dotted: screening)", LIGHT)
    axis_legend(axes, LIGHT)


def _draw_screening(axes: Axes, screening: dict[str, list[float]]) -> None:
    """The wider walk as thin lines, one for each stack."""
    rows: dict[float, list[tuple[float, float]]] = {}
    for key, limits in screening.items():
        choice = choice_of(key)
        if (choice.knee_gear, choice.spring, choice.leg) == (7.0, 800.0, 1.0):
            rows.setdefault(choice.stack, []).append((choice.hip_gear, limits[0]))
    for stack, row in sorted(rows.items()):
        across, up = zip(*sorted(row), strict=True)
        axes.plot(across, up, ":", color=LIGHT.muted, lw=1.0)
        axes.annotate(f"{stack:g}", (across[0], up[0]), (-2, 2), textcoords="offset points", fontsize=7)


def _draw_gains(axes: Axes, cells: dict[str, Any]) -> None:
    for color, (stack, row) in zip(COLORS, _rows(cells).items(), strict=False):
        for model, style in (("simplified-dc", ":"), ("square", "-")):
            gains = [
                100.0 * (cell["limits"][model]["speed"] / cell["limits"]["refined"]["speed"] - 1.0)
                for _, cell in row
            ]
            label = f"{model}, stack {stack:g}" if stack == EDITIONS["bp2"].stack else None
            axes.plot([gear for gear, _ in row], gains, style, marker=".", color=color, label=label)
    for gain in (SIMPLIFIED_GAIN, SQUARE_GAIN):
        axes.axhline(100.0 * gain, color=LIGHT.muted, ls="--")
    axes.set(xlabel="gear ratio of the hip", ylabel="above the refined limit [%]")
    set_title(axes, "What other motor models promise", LIGHT)
    axis_legend(axes, LIGHT)


def _draw_policies(axes: Axes) -> None:
    rows = json.loads(POLICIES.read_text(encoding="utf-8"))["robots"]
    for place, row in enumerate(rows.values()):
        axes.barh(place, row["limit_m_s"], color=LIGHT.muted, alpha=0.4)
        for index, (policy, speed) in enumerate(row["policies"].items()):
            axes.plot(speed, place, "o", color=LIGHT.speed)
            text, shift = f"{policy} {speed:.2f}", (-4, 7 - 18 * index)
            axes.annotate(text, (speed, place), shift, textcoords="offset points", ha="right", fontsize=7)
    axes.set_yticks(range(len(rows)), [f"{name}\n{row['strides']}" for name, row in rows.items()])
    axes.set(xlabel="limit (bar) and policies (dots) [m/s]")
    set_title(axes, "Robots, limits, policies", LIGHT)


def main(workers: int = 2, result: Path = RESULT) -> None:
    """The whole walk: the grid with one start, the cells at its edge of the rules with eight.

    Args:
        workers: processes.
        result: file to go on with and to write.
    """
    calibration = Calibration(result, workers)
    near = sorted(coarse(), key=lambda choice: distance(choice, EDITIONS["bp2"]))
    calibration.add(near, SCREEN_STARTS)
    calibration.add([choice_of(key) for key in FINE], FINE_STARTS, lift=True)
    calibration.add([choice_of(key) for key in SPRINGS_AND_LEGS], FINE_STARTS)
    draw(calibration.cells, calibration.screening, FIGURE)


if __name__ == "__main__":
    tyro.cli(main)
