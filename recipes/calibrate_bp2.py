"""Calibrate the BP2 surrogate: its speed limits over motor, gears, spring and leg, before any training.

    python recipes/calibrate_bp2.py --workers 32       3 minutes (1.6 CPU hours); goes on where it stopped

Every cell is a robot of the family ``recipes/bp2_editions.py``. Its fastest stride of at most 5.5 Hz and a
duty of at least 0.12 is searched under three motor models: ``refined``, ``simplified-dc`` (no inductance) and
``square`` (peak torque at every speed). Stages, each one over all cells:

1. random: eight starts, each a process of its own and with a seed of its own.
2. known, twice: climbs from the best strides of the cell, of narrower motor models and of the nearest cells.
3. lifted: the refined limit without the hip's torque limit, and without the knee's.

The three editions are searched four times more with other seeds, each run for itself: how far runs differ.
Every search that ends is a line of climbs.jsonl in the folder of the run; what is there is not done again
(after a change of the search or of the family, begin a new folder). All limits land in one file,
results/speed_limit/bp2.json; recipes/bp2_calibration_figure.py draws it.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, replace
from itertools import product
from multiprocessing import get_context
from pathlib import Path
from time import monotonic, process_time
from typing import Any

import numpy as np
import tyro
from bp2_editions import EDITIONS, Surrogate, surrogate_robot
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from sprintlab.core.errors import SimulationError
from sprintlab.core.files import atomic_write_text
from sprintlab.motors import no_load_speed
from sprintlab.robots import RobotDescription
from sprintlab.speed_limit import (
    Fastest,
    Runner,
    SearchSettings,
    evaluate,
    fastest_stride,
    runner_from_robot,
    stride_facts,
)
from sprintlab.speed_limit.stride import GROUPS, PARAMETERS

MODELS = ("refined", "simplified-dc", "square")
MAX_STRIDE, MIN_DUTY = 5.5, 0.12
HIP_GEARS = (7.5, 7.75, 8.0, 8.25, 8.5)
KNEE_GEARS = {
    1.2: (8.0,),
    1.25: (7.75, 8.0),
    1.3: (7.0, 7.25, 7.5),
    1.35: (7.0, 7.25, 7.5),
    1.4: (7.0, 7.25, 7.5),
    1.5: (7.0,),
    1.6: (7.0, 7.5),
    1.8: (7.0,),
}
"""Stacks with the knee gears that are searched: from the lowest that gives the knee 2.5 N m per kg (but not
below 7, where it would turn faster than 37 rad/s), and 7 for the smaller stacks too."""
SPRINGS, LEGS = (500.0, 600.0, 1000.0, 1200.0), (0.95, 1.05)
ISOLATED_RUNS = 4
KNOWN_ROUNDS, NEIGHBOURS = 2, 2
RESULT, FOLDER = Path("results/speed_limit/bp2.json"), Path("runs/calibrate-bp2")
REFINED, SIMPLIFIED_GAIN, SQUARE_GAIN = 13.2, 0.02, 0.09
FACTS = ("frequency", "duty", "peak_force", "hip_full", "knee_full", "mechanical_power", "copper_loss")

Stride = tuple[float, list[float]]


@dataclass(frozen=True)
class Job:
    """One search: climbs from known strides, from random ones and from the best of them, shaken.

    Random and shaken starts are one each, two in the last stage.

    Attributes:
        cell: key of a robot of the grid (``key_of``), or the name of an edition and of a run: ``bp2 run 1``.
        model: motor model.
        stage: ``random``, ``known 0``, ``known 1`` or ``without hip``, ``without knee``.
        seed: of the random stride and of the shaking.
        near: known strides as ``(speed, parameters)``.
    """

    cell: str
    model: str
    stage: str
    seed: int
    near: tuple[Stride, ...] = ()

    @property
    def identity(self) -> tuple[str, str, str, int]:
        """What tells it from other jobs."""
        return self.cell, self.model, self.stage, self.seed


def key_of(choice: Surrogate) -> str:
    """``stack/hip gear/knee gear/spring/leg``."""
    return "/".join(
        f"{value:g}" for value in (choice.stack, choice.hip_gear, choice.knee_gear, choice.spring, choice.leg)
    )


def choice_of(cell: str) -> Surrogate:
    """The robot of a cell: inverse of ``key_of``, or an edition."""
    if "/" not in cell:
        return EDITIONS[cell.split()[0]]
    stack, hip, knee, spring, leg = (float(word) for word in cell.split("/"))
    return Surrogate(stack=stack, hip_gear=hip, knee_gear=knee, spring=spring, leg=leg)


def grid() -> Iterator[Surrogate]:
    """Motors and gears with the template's springs and legs; then other springs and legs of the choice."""
    for stack, knees in KNEE_GEARS.items():
        for hip, knee in product(HIP_GEARS, knees):
            yield Surrogate(stack=stack, hip_gear=hip, knee_gear=knee)
    for spring in SPRINGS:
        yield replace(EDITIONS["bp2"], spring=spring)
    for leg in LEGS:
        yield replace(EDITIONS["bp2"], leg=leg)


def isolated() -> list[str]:
    """Cells of the editions' own runs, that learn nothing from their neighbours."""
    return [f"{name} run {run}" for name in EDITIONS for run in range(1, ISOLATED_RUNS + 1)]


def search(job: Job) -> dict[str, Any]:
    """Carry a job out: what a line of the log holds."""
    begun = process_time()
    runner = replace(runner_from_robot(surrogate_robot(choice_of(job.cell))), motor_model=job.model)
    starts = 2 if job.stage.startswith("without") else 1
    settings = SearchSettings(max_stride=MAX_STRIDE, min_duty=MIN_DUTY, starts=starts, seed=job.seed)
    near = [Fastest(speed=speed, parameters=np.array(stride)) for speed, stride in job.near]
    lifted = job.stage.removeprefix("without ") if job.stage.startswith("without ") else None
    groups = [group for group in GROUPS if lifted is None or not group.startswith(lifted)]
    ceiling = 2.0 * near[0].speed if lifted else None
    try:
        found = fastest_stride(runner, settings, groups=groups, near=near, ceiling=ceiling)
    except SimulationError:
        found = Fastest(speed=0.0, parameters=np.zeros(PARAMETERS))
    return {
        "job": list(job.identity),
        "speed": round(found.speed, 4),
        "found": [round(speed, 2) for speed in found.found],
        "stride": [float(f"{value:.6g}") for value in found.parameters],
        "cpu_s": round(process_time() - begun, 2),
    }


class Log:
    """Searches that have ended, in a file that grows by a line with each."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.path = folder / "climbs.jsonl"
        text = self.path.read_text(encoding="utf-8") if self.path.is_file() else ""
        whole = text[: text.rfind("\n") + 1]  # a kill may have torn the last line
        atomic_write_text(self.path, whole)
        self.entries = [json.loads(line) for line in whole.splitlines()]
        self.done = {tuple(entry["job"]) for entry in self.entries}

    def add(self, entry: dict[str, Any]) -> None:
        """Keep a search's result."""
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(entry, separators=(",", ":")) + "\n")
        self.entries.append(entry)
        self.done.add(tuple(entry["job"]))

    def limits(self) -> dict[str, dict[str, Stride]]:
        """Best stride of every cell by motor model."""
        best: dict[str, dict[str, Stride]] = {}
        for entry in self.entries:
            cell, model, stage, _ = entry["job"]
            known = best.setdefault(cell, {})
            faster = entry["speed"] > known.get(model, (0.0, []))[0]
            if faster and not stage.startswith("without"):
                known[model] = (entry["speed"], entry["stride"])
        return best


# --- the stages ---------------------------------------------------------------------------------------------


def random_jobs(cells: Sequence[str], starts: int) -> Iterator[Job]:
    """Stage 1: the seeds of a run differ from those of every other run."""
    for seed, cell, model in product(range(starts), cells, MODELS):
        yield Job(cell, model, "random", 1000 * _run_of(cell) + seed)


def known_jobs(cells: Sequence[str], log: Log, stage: int) -> Iterator[Job]:
    """Stage 2: from what the cell, narrower motor models and the nearest cells came to."""
    limits = log.limits()
    shared = [cell for cell in limits if "/" in cell]
    for cell, (place, model) in product(cells, enumerate(MODELS)):
        near = [limits[cell][narrow] for narrow in MODELS[: place + 1] if narrow in limits.get(cell, {})]
        if "/" in cell:
            others = sorted((c for c in shared if c != cell), key=lambda c: distance(cell, c))[:NEIGHBOURS]
            near += [limits[other][model] for other in others if model in limits[other]]
        yield Job(cell, model, f"known {stage}", 1000 * _run_of(cell) + 100 * (stage + 1), tuple(near))


def lifted_jobs(cells: Sequence[str], log: Log) -> Iterator[Job]:
    """Stage 3: the refined limit without one joint's torque limit."""
    limits = log.limits()
    for cell, joint in product(cells, ("hip", "knee")):
        if "/" in cell and "refined" in limits.get(cell, {}):
            yield Job(cell, "refined", f"without {joint}", 300, (limits[cell]["refined"],))


def _run_of(cell: str) -> int:
    return 0 if "/" in cell else int(cell.split()[-1])


def distance(first: str, second: str) -> float:
    """How far two robots are from each other, in steps of the grid."""
    one, two = choice_of(first), choice_of(second)
    steps = (
        (one.stack - two.stack) / 0.1,
        (one.hip_gear - two.hip_gear) / 0.25,
        (one.knee_gear - two.knee_gear) / 0.5,
        np.log(one.spring / two.spring) / np.log(1.25),
        (one.leg - two.leg) / 0.05,
    )
    return float(np.linalg.norm(steps))


class Walk:
    """All stages on some processes, until they are through or the time is up."""

    def __init__(self, log: Log, workers: int, minutes: float | None) -> None:
        self.log, self.workers = log, workers
        self._end = None if minutes is None else monotonic() + 60.0 * minutes

    def run(self, cells: Sequence[str], starts: int) -> bool:
        """Whether every stage is through."""
        for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
            os.environ[name] = "1"  # the processes are spawned: they load NumPy anew
        with (
            ProcessPoolExecutor(self.workers, mp_context=get_context("spawn")) as pool,
            Progress() as progress,
        ):
            through = self._stage(pool, progress, "random", random_jobs(cells, starts))
            for stage in range(KNOWN_ROUNDS):
                through = through and self._stage(
                    pool, progress, f"known {stage}", known_jobs(cells, self.log, stage)
                )
            return through and self._stage(pool, progress, "lifted", lifted_jobs(cells, self.log))

    def _stage(self, pool: ProcessPoolExecutor, progress: Progress, name: str, jobs: Iterable[Job]) -> bool:
        todo = [job for job in jobs if job.identity not in self.log.done]
        bar = progress.add_task(name, total=len(todo))
        waiting = [pool.submit(search, job) for job in todo]
        for future in as_completed(waiting):
            if future.cancelled():
                continue
            self.log.add(future.result())
            progress.advance(bar)
            if self._end is not None and monotonic() > self._end:
                for other in waiting:
                    other.cancel()  # those that run come to their end
        return not any(future.cancelled() for future in waiting)


# --- the file -----------------------------------------------------------------------------------------------


def document(log: Log) -> dict[str, Any]:
    """Everything that was found, as results/speed_limit/bp2.json keeps it."""
    limits = log.limits()
    whole = {cell: by_model for cell, by_model in sorted(limits.items()) if len(by_model) == len(MODELS)}
    return {
        "max_stride_hz": MAX_STRIDE,
        "min_duty": MIN_DUTY,
        "searches": len(log.entries),
        "cpu_s": round(sum(entry["cpu_s"] for entry in log.entries)),
        "cells are": "stack/hip gear/knee gear/spring [N m/rad]/leg length over 0.63 m",
        "runs": {cell: _run(cell, log) for cell in whole if "/" not in cell},
        "cells": {cell: _cell(cell, whole[cell], log) for cell in whole if "/" in cell},
    }


def _run(cell: str, log: Log) -> dict[str, float]:
    """Limits of one isolated run of an edition [m/s]."""
    limits = log.limits()[cell]
    return {model: round(limits[model][0], 3) for model in MODELS}


def _cell(cell: str, limits: dict[str, Stride], log: Log) -> dict[str, Any]:
    robot = surrogate_robot(choice_of(cell))
    runner = runner_from_robot(robot)
    mine = [entry for entry in log.entries if entry["job"][0] == cell]
    found = {model: _random_starts(mine, model) for model in MODELS}
    lifted = {
        joint: [entry["speed"] for entry in mine if entry["job"][2] == f"without {joint}"]
        for joint in ("hip", "knee")
    }
    entry = {
        "starts": min(len(speeds) for speeds in found.values()),
        "limits": {
            model: _limit(replace(runner, motor_model=model), *limits[model], found[model])
            for model in MODELS
        },
        **joint_facts(robot),
    }
    if all(lifted.values()):
        entry["without"] = {joint: round(max(speeds), 3) for joint, speeds in lifted.items()}
    return entry


def _random_starts(entries: Sequence[dict[str, Any]], model: str) -> list[float]:
    """What each start of the first stage came to [m/s]."""
    return [
        round(entry["speed"], 2)
        for entry in sorted(entries, key=lambda entry: entry["job"][3])
        if entry["job"][1:3] == [model, "random"]
    ]


def _limit(runner: Runner, speed: float, stride: Sequence[float], found: list[float]) -> dict[str, Any]:
    parameters = np.array(stride)
    facts = asdict(stride_facts(runner, evaluate(runner, parameters[None], speed), speed))
    return {
        "speed": round(speed, 3),
        "found": found,
        **{name: float(f"{facts[name]:.3g}") for name in FACTS},
        "stride": [float(f"{value:.5g}") for value in stride],
    }


def joint_facts(robot: RobotDescription) -> dict[str, list[float]]:
    """What the joints of hip and knee can do: peak torque [N m] and no-load speed [rad/s]."""
    peak = runner_from_robot(robot).peak_torque
    speed = np.asarray(no_load_speed(robot.motors, robot.bus_voltage)) / np.asarray(robot.gear.ratio)
    return {
        "peak_torque": [round(float(v), 1) for v in peak],
        "no_load": [round(float(v), 2) for v in speed[1:3]],
    }


def write(path: Path, content: dict[str, Any]) -> None:
    """The file, one line a cell."""
    cells = content["cells"]
    lines = [f"{json.dumps(key)}: {json.dumps(cells[key], separators=(',', ':'))}" for key in cells]
    head = json.dumps({key: value for key, value in content.items() if key != "cells"}, indent=1)
    path.parent.mkdir(parents=True, exist_ok=True)
    atomic_write_text(path, head[:-2] + ',\n "cells": {\n' + ",\n".join(lines) + "\n}}\n")


# --- rules --------------------------------------------------------------------------------------------------


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


def table(content: dict[str, Any]) -> Table:
    """The map, one row per cell: limit, third best start, gains of other models, rules that it breaks."""
    found = Table(title=f"{content['searches']} searches, {content['cpu_s']} CPU s")
    for column in ("cell", "starts", "refined", "third", "no L", "square", "breaks"):
        found.add_column(column, no_wrap=True)
    for key, cell in content["cells"].items():
        refined, simplified, square = (cell["limits"][model]["speed"] for model in MODELS)
        third = sorted(cell["limits"]["refined"]["found"], reverse=True)[:3][-1]
        broken = ", ".join(rule for rule, held in rules(cell).items() if not held)
        gains = (f"{100.0 * (speed / refined - 1.0):+.1f} %" for speed in (simplified, square))
        found.add_row(key, str(cell["starts"]), f"{refined:.2f}", f"{third:.2f}", *gains, broken or "-")
    for run, limits in content["runs"].items():
        found.add_row(
            run,
            "",
            f"{limits['refined']:.2f}",
            "",
            f"{limits['simplified-dc']:.2f}",
            f"{limits['square']:.2f}",
            "",
        )
    return found


def main(
    workers: int = 2,
    starts: int = 8,
    minutes: float | None = None,
    only: tuple[str, ...] = (),
    folder: Path = FOLDER,
    result: Path = RESULT,
) -> None:
    """Search what is missing, write the limits and print the map.

    Args:
        workers: processes.
        starts: random starts of every cell under every motor model.
        minutes: stop after this time, keep what was found; run again to go on. No limit when left out.
        only: cells instead of the whole map, such as 1.4/8.25/7/800/1 or "bp2-weak run 1".
        folder: folder of the run, to go on with.
        result: file to write.
    """
    log = Log(folder)
    near = key_of(EDITIONS["bp2"])
    cells = list(only) or [*isolated(), *sorted(map(key_of, grid()), key=lambda cell: distance(near, cell))]
    through = Walk(log, workers, minutes).run(cells, starts)
    content = document(log)
    write(result, content)
    console = Console()
    console.print(table(content))
    console.print(f"{result}: " + ("complete" if through else "time is up, run again to go on"))


if __name__ == "__main__":
    tyro.cli(main)
