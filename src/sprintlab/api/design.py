"""``design``: which gears and which winding a robot should have, and what a wrong motor model costs there."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import partial
from math import nan
from pathlib import Path
from typing import Any

from sprintlab.api.results import Drawn, Progress, drawn, records, silent
from sprintlab.api.trained_designs import judge_designs, train_designs
from sprintlab.core.arguments import checked
from sprintlab.core.checks import check_positive, check_range
from sprintlab.core.files import atomic_write_json
from sprintlab.core.reading import read_json
from sprintlab.evaluation.pool import WorkerProcesses
from sprintlab.robots import load_robot_file, read_table, robot_fingerprint, robot_table_path
from sprintlab.speed_limit import Fastest, SearchSettings
from sprintlab.speed_limit import designs as laws

RECORD = "design.json"
SHOWN = 20
"""Designs in the printed table, the fastest; the JSON has all."""


@checked
def design(
    robot: str | Path,
    *,
    vary: Sequence[str],
    current: float | None = None,
    starts: int = 16,
    max_stride: float | None = None,
    min_duty: float | None = None,
    workers: int | None = None,
    output: Path | str = Path("runs/design"),
    minutes: float | None = None,
    iterations: int | None = None,
    seeds: int = 2,
    environments: int | None = None,
    device: str = "auto",
    parallel: int = 1,
    progress: Progress = silent,
) -> Drawn:
    """Choose gears and winding at fixed mass, and say what leaving the d-axis voltage out would cost.

    Every design gets a folder with its robot's table, which other commands take, and its design.json; the
    same command, started again, continues from there. With --minutes or --iterations, policies of every
    design are trained under the refined motor and under v_d = 0, and judged with the refined motor. Without
    them nothing is trained, and the policies that are finished are judged.
    Example: sprintlab design bp2 --vary gear.hip=6:10:5 --vary winding=0.8,1,1.2
    Example: sprintlab design bp2 --vary gear.hip=6:11 --minutes 3 --parallel 3 --figure map.png

    Args:
        robot: name of a robot, or the path of its folder or table.
        vary: what is varied: gear.abad, gear.hip, gear.knee (ratios) and winding (turns over the robot's own,
            at the same copper), as NAME=LOW:HIGH, which is six values, NAME=LOW:HIGH:COUNT or
            NAME=VALUE,VALUE; several make all combinations.
        current: greatest phase current of the inverters [A]; a winding of few turns then loses peak torque.
            When left out, every winding gets the current that it needs.
        starts: random strides from which each search begins.
        max_stride: highest stride frequency that counts [Hz]; what the motors allow when left out.
        min_duty: lowest share of a stride in which a foot stands; what the motors allow when left out.
        output: folder in which the robot's designs get a folder of its name.
        minutes: training time of each policy [min].
        iterations: iteration at which each training ends.
        seeds: trainings per design and motor model.
        environments: robots side by side in each training; when left out, as many as in sprintlab train.
        device: auto: all GPUs of this machine, or its CPU; or one of them: cuda:0, cpu.
        parallel: trainings that share a GPU, or the CPU; memory must allow it.
    """
    check_range("seeds", seeds, 1, 1000)
    check_range("parallel", parallel, 1, 64)
    if current is not None:
        check_positive("current", current, "A")
    settings = SearchSettings(starts=starts, max_stride=max_stride, min_duty=min_duty)
    wanted = laws.all_designs(laws.parse_variations(vary))
    table_path = robot_table_path(robot)
    name, rows = read_table(table_path)
    folders = [Path(output) / name / laws.design_name(each) for each in wanted]
    for folder, each in zip(folders, wanted, strict=True):
        changed = laws.redesigned(rows, each, current)
        laws.write_robot(
            folder / "parameters.toml", f"{name}-{laws.design_name(each)}", changed, str(table_path)
        )
    found: list[dict[str, Any]] = []
    with WorkerProcesses(workers) as processes:
        work = partial(limits_of, settings)
        for row in processes.map(work, list(zip(folders, wanted, strict=True))):
            found.append(row)
            progress(f"{len(found)} of {len(folders)} speed limits", len(found) / len(folders))
    if minutes is not None or iterations is not None:
        train_designs(
            folders, seeds=seeds, device=device, parallel=parallel, progress=progress,
            minutes=minutes, iterations=iterations, environments=environments,
        )  # fmt: skip
    with WorkerProcesses(workers) as processes:
        trained = judge_designs(folders, processes, progress)
    return _told(name, [row | {"trained": each} for row, each in zip(found, trained, strict=True)])


def limits_of(settings: SearchSettings, place: tuple[Path, Mapping[str, float]]) -> dict[str, Any]:
    """The record of a design with its speed limits under both motor models, computed where it is missing."""
    folder, values = place
    robot = load_robot_file(folder / "parameters.toml")
    asked = {**asdict(settings), "robot_fingerprint": robot_fingerprint(robot)}
    path = folder / RECORD
    if path.is_file() and (record := read_json(path, what="record"))["asked"] == asked:
        return record
    limits, near = dict[str, Any](), list[Fastest]()
    for model in laws.MODELS:
        stride, limits[model] = laws.design_limit(robot, model, settings, near)
        near.append(stride)
    record = {"design": dict(values), "asked": asked, "current_A": laws.peak_current(robot), "limits": limits}
    atomic_write_json(path, record)
    return record


def _told(name: str, rows: Sequence[Mapping[str, Any]]) -> Drawn:
    """Table of the fastest by the refined motor's limit, map and the sentences."""
    trained = [row for row in rows if row["trained"]]
    choices = [laws.choose(rows), *([laws.choose(trained, trained=True)] if trained else [])]
    sentences = [choice.sentence() for choice in choices]
    numbers = {
        "robot": name,
        "designs": [_rounded(row) for row in rows],
        "chosen": {model: laws.design_name(each) for model, each in choices[0].chosen.items()},
        "sentence": " ".join(sentences),
    }
    ranked = sorted(rows, key=lambda row: -row["limits"]["refined"]["speed_m_s"])[:SHOWN]
    title = f"Designs of {name}, {len(ranked)} of {len(rows)}, fastest first"
    notes = ["without d axis: what a motor with v_d = 0 promises; everything else by the refined motor"]
    if trained:
        notes.append(f"trained: mean of the seeds, by the refined motor; {len(trained)} designs have any")
    shown = [records(title, [_row(each, bool(trained)) for each in ranked]), *notes, *sentences]
    draw = drawn("speed_limit.figure.designs_figure", name, rows, len(trained) == len(rows))
    return Drawn(numbers=numbers, shown=shown, found=choices[-1], draw=draw)


def _rounded(row: Mapping[str, Any]) -> dict[str, Any]:
    """A record without what only a restart needs, floats to 1e-3."""
    kept = {name: value for name, value in row.items() if name != "asked" and value}
    return json.loads(json.dumps(kept), parse_float=lambda text: round(float(text), 3))


def _row(row: Mapping[str, Any], trained: bool) -> dict[str, Any]:
    """What stands of a design in the table."""
    judge, other = (row["limits"][model] for model in laws.MODELS)
    found = {
        **row["design"],
        "limit_m_s": judge["speed_m_s"],
        "without_d_axis_m_s": other["speed_m_s"],
        "current_A": row["current_A"],
        "power_W": judge["power_W"],
        "winding_degC": judge["winding_degC"],
    }
    if trained:
        names = ("trained_m_s", "trained_without_d_axis_m_s")
        speeds = (row["trained"].get(model, {}).get("speed_m_s", nan) for model in laws.MODELS)
        found |= dict(zip(names, speeds, strict=True))
    return {name: round(value, 0 if value > 30.0 else 2) for name, value in found.items()}
