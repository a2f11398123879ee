"""``design``: which gears and which winding a robot should have, and what a wrong motor model costs there."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

from sprintlab.api.evaluations import protocol_settings
from sprintlab.api.results import Drawn, Progress, drawn, records, silent
from sprintlab.api.training import require_training
from sprintlab.core.arguments import checked
from sprintlab.core.checks import check_positive, check_range
from sprintlab.core.errors import SprintlabError
from sprintlab.core.files import atomic_write_json
from sprintlab.core.reading import read_json
from sprintlab.evaluation.pool import TrialPool, WorkerProcesses
from sprintlab.evaluation.protocol import run_protocol
from sprintlab.evaluation.reached import require_a_runner
from sprintlab.evaluation.trial import TrialRequest
from sprintlab.motors import MotorModel, WindingHeat
from sprintlab.plant import PlantOptions
from sprintlab.robots import (
    RobotDescription,
    load_robot_file,
    read_table,
    robot_fingerprint,
    robot_table_path,
)  # fmt: skip
from sprintlab.speed_limit import Fastest, SearchSettings
from sprintlab.speed_limit import designs as laws
from sprintlab.training.runs import sweep

RECORD = "design.json"
METHODS: dict[MotorModel, str] = {"refined": "acs", "simplified-dc": "simplified-dc"}
"""Method of a training by the motor model that its designer believes."""
TRIALS = 3
"""Seeded trials per speed of a design's policy."""
SHOWN = 20
"""Designs in the printed table, the fastest; the JSON has all."""


@checked
def design(
    robot: str | Path,
    *,
    vary: Sequence[str],
    current: float | None = None,
    starts: int = 6,
    max_stride: float | None = None,
    min_duty: float | None = None,
    train: int = 0,
    minutes: float = 7.0,
    device: str = "auto",
    workers: int | None = None,
    output: Path | str = Path("runs/design"),
    progress: Progress = silent,
) -> Drawn:
    """Choose gears and winding at fixed mass, and say what leaving the d-axis voltage out would cost.
    Every design gets a folder with its robot's table, which other commands take, and its design.json; the
    same command goes on where it was.
    Example: sprintlab design bp2 --vary gear.hip=6:10:5 --vary winding=0.8,1,1.2

    Args:
        robot: name of a robot, or the path of its folder or table.
        vary: what is varied: gear.abad, gear.hip, gear.knee (ratios) and winding (turns over the robot's own,
            at the same copper), as NAME=LOW:HIGH:COUNT or NAME=VALUE,VALUE; several make all combinations.
        current: greatest phase current of the inverters [A]; a winding of few turns then loses peak torque.
            When left out, every winding gets the current that it needs.
        starts: random strides from which each search begins.
        max_stride: highest stride frequency that counts [Hz]; what the motors allow when left out.
        min_duty: lowest share of a stride in which a foot stands; what the motors allow when left out.
        train: also train this many seeds for each design under each motor model, and run them in the plant.
        minutes: length of each of these trainings.
        device: of the trainings: auto for all GPUs of this machine, one training on each; or cuda:0, cpu.
        output: folder in which the robot's designs get a folder of its name.
    """
    check_range("train", train, 0, 100)
    check_positive("minutes", minutes, "min")
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
        if train:
            require_training()
            train_designs(folders, train, minutes, device, progress)
            for number, folder in enumerate(folders):
                progress(f"{number} of {len(folders)} designs run in the plant", number / len(folders))
                found[number] = trained_of(folder, train, processes)
    return _told(name, found)


def limits_of(settings: SearchSettings, place: tuple[Path, Mapping[str, float]]) -> dict[str, Any]:
    """The record of a design with its speed limits under both motor models, computed where it is missing."""
    folder, values = place
    robot = load_robot_file(folder / "parameters.toml")
    asked = {**asdict(settings), "robot_fingerprint": robot_fingerprint(robot)}
    if (record := read_record(folder)) and record["asked"] == asked:
        return record
    limits, near = dict[str, Any](), list[Fastest]()
    for model in laws.MODELS:
        stride, limits[model] = laws.design_limit(robot, model, settings, near)
        near.append(stride)
    record = {"design": dict(values), "asked": asked, "current_A": laws.peak_current(robot), "limits": limits}
    atomic_write_json(folder / RECORD, record)
    return record


def read_record(folder: Path) -> dict[str, Any]:
    """The record of a design; empty before it has been computed. Raises ``SprintlabError``."""
    path = folder / RECORD
    return read_json(path, what="record") if path.is_file() else {}


def train_designs(
    folders: Sequence[Path], seeds: int, minutes: float, device: str, progress: Progress
) -> None:
    """Train every design under both motor models, a training on each GPU. Raises ``SprintlabError``."""
    runs = [
        replace(run, name=f"{folder.name} {run.name}", words=(*run.words, "--plain"))
        for folder in folders
        for run in sweep.plan_sweep(
            folder,
            robot=str(folder / "parameters.toml"),
            methods=tuple(METHODS.values()),
            seeds=range(seeds),
            minutes=minutes,
        )
    ]

    def watch(states: Mapping[str, str]) -> None:
        done = sum(state == "finished" for state in states.values())
        progress(f"{done} of {len(runs)} trainings finished", done / len(runs))

    sweep.train_all(runs, sweep.training_devices(device), 1, watch)


def trained_of(folder: Path, seeds: int, processes: WorkerProcesses) -> dict[str, Any]:
    """The record of a design with what its policies hold in the plant, run where that is missing.
    The policies of each motor model run with that motor, which is what their designer believes; those of
    v_d = 0 also with the refined one.
    """
    record, robot = read_record(folder), load_robot_file(folder / "parameters.toml")
    known: dict[str, Any] = record.setdefault("policies", {})
    for model in METHODS:
        for seed in range(seeds):
            judges: tuple[MotorModel, ...] = (model, "refined")
            for judge in dict.fromkeys(judges):
                key = f"{model}/seed-{seed} in {judge}"
                if key not in known:
                    policy = folder / METHODS[model] / f"seed-{seed}" / "policy.onnx"
                    known[key] = held_by(policy, robot, judge, processes)
                    atomic_write_json(folder / RECORD, record)
    record["trained"] = {
        model: _mean_of([known[f"{model}/seed-{seed} in {model}"] for seed in range(seeds)])
        for model in METHODS
    }
    record["trained"]["simplified-dc"]["judged_m_s"] = _mean_of(
        [known[f"simplified-dc/seed-{seed} in refined"] for seed in range(seeds)]
    )["speed_m_s"]
    atomic_write_json(folder / RECORD, record)
    return record


def held_by(
    policy: Path, robot: RobotDescription, model: MotorModel, processes: WorkerProcesses
) -> dict[str, float]:
    """Most speed that a policy holds upright in the plant with a motor model; its power and its windings.

    Returns:
        Speed [m/s]; of a policy that runs also power from the bus [W] and the hottest winding at the end of
        a hold from 25 degC [degC].
    """
    plant = PlantOptions(motor_model=model)
    settings = protocol_settings(TRIALS, 0, start=1.0, top=16.0, grid=0.5, first_step=1.0, plant=plant)
    with TrialPool(policy, robot, processes=processes) as pool:
        try:
            require_a_runner(pool, settings.start)
        except SprintlabError:
            return {"speed_m_s": 0.0}
        tried = [each for each in run_protocol(pool, self_paced=False, settings=settings).speeds if each.ran]
        if not tried:
            return {"speed_m_s": 0.0}
        running = max(tried, key=lambda each: each.running_speed)
        request = TrialRequest(top_speed=running.top_speed, plant=replace(plant, heat=WindingHeat()))
        (warm,) = pool.trials([request])
    hottest = warm.metrics.hottest_winding
    assert hottest is not None
    powers = [trial.metrics.electrical_power for trial in running.trials if not trial.fall_reason]
    return {
        "speed_m_s": running.running_speed,
        "power_W": sum(powers) / len(powers),
        "winding_degC": hottest,
    }


def _mean_of(seeds: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Means over seeds: of the speed, 0 where a policy does not run; of the rest, over those that do."""
    speeds, ran = [each["speed_m_s"] for each in seeds], [each for each in seeds if "power_W" in each]
    found = {"speed_m_s": sum(speeds) / len(speeds), "spread_m_s": max(speeds) - min(speeds)}
    means = {name: sum(each[name] for each in ran) / len(ran) for name in ("power_W", "winding_degC") if ran}
    return {**found, **means}


def _told(name: str, rows: Sequence[Mapping[str, Any]]) -> Drawn:
    """Table of the fastest by the refined motor's limit, map and the sentences."""
    chosen = [found for source in ("limits", "trained") if (found := laws.choose(rows, source))]
    sentences = [choice.sentence() for choice in chosen]
    numbers = {
        "robot": name,
        "designs": [_rounded(row) for row in rows],
        "chosen": {
            choice.source: {model: laws.design_name(each) for model, each in choice.chosen.items()}
            for choice in chosen
        },
        "sentences": sentences,
    }
    ranked = sorted(rows, key=lambda row: -row["limits"]["refined"]["speed_m_s"])[:SHOWN]
    title = f"Designs of {name}, {len(ranked)} of {len(rows)}, fastest first"
    note = "without d axis: what a motor with v_d = 0 promises; everything else by the refined motor"
    shown = [records(title, [_row(each) for each in ranked]), note, *sentences]
    draw = drawn("speed_limit.figure.designs_figure", name, rows)
    return Drawn(numbers=numbers, shown=shown, found=chosen, draw=draw)


def _rounded(row: Mapping[str, Any]) -> dict[str, Any]:
    """A record without what only a restart needs, floats to 1e-3."""
    kept = {name: value for name, value in row.items() if name not in ("asked", "policies")}
    return json.loads(json.dumps(kept), parse_float=lambda text: round(float(text), 3))


def _row(row: Mapping[str, Any]) -> dict[str, Any]:
    """What stands of a design in the table."""
    judge, other = (row["limits"][model] for model in METHODS)
    found = {
        **row["design"],
        "limit_m_s": judge["speed_m_s"],
        "without_d_axis_m_s": other["speed_m_s"],
        "current_A": row["current_A"],
        "power_W": judge["power_W"],
        "winding_degC": judge["winding_degC"],
    }
    if trained := row.get("trained"):
        held, promised = (trained[model]["speed_m_s"] for model in METHODS)
        judged = trained["simplified-dc"]["judged_m_s"]
        found |= {"trained_m_s": held, "trained_without_m_s": promised, "of_it_left_m_s": judged}
    return {name: round(value, 0 if value > 30.0 else 2) for name, value in found.items()}
