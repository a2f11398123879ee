"""Designs of a robot trained under each motor model, and what their policies hold with the refined motor.

A policy lies in ``<design>/<method>/seed-<k>/policy.onnx``; what a motor model says of it, beside it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from sprintlab.api.results import Progress
from sprintlab.api.training import require_training
from sprintlab.core.files import atomic_write_json, file_sha256
from sprintlab.core.json_values import json_ready
from sprintlab.core.reading import read_json
from sprintlab.evaluation.pool import TrialPool, WorkerProcesses
from sprintlab.evaluation.protocol import ProtocolSettings, run_protocol_near
from sprintlab.evaluation.results import SpeedResult
from sprintlab.motors import MotorModel, WindingHeat
from sprintlab.plant import PlantOptions
from sprintlab.robots import load_robot_file
from sprintlab.speed_limit.designs import MODELS
from sprintlab.training.runs.sweep import SweptRun, plan_sweep, train_all, training_devices

METHODS: Mapping[MotorModel, str] = dict(zip(MODELS, ("acs", "simplified-dc"), strict=True))
"""The method that trains under a motor model; both are the same but for it."""
JUDGE = ProtocolSettings(trials=3, required=3, first_step=2.0, grid=0.5)
"""How the highest speed of a policy is searched."""
LIKELY = 5.0
"""Where that search begins [m/s], unless a policy falls there."""
RETRIES = 1
"""How often a training that failed or was killed is started again."""


def train_designs(
    folders: Sequence[Path], *, seeds: int, device: str, parallel: int, progress: Progress, **limits: Any
) -> None:
    """Train what is not finished, as ``training.runs.sweep.train_all``, which says what is raised.

    Args:
        folders: folders of the designs.
        limits: values of ``minutes``, ``iterations`` and ``environments`` of ``sprintlab train``.
    """
    require_training()

    def watch(states: Mapping[str, str]) -> None:
        done = sum(state == "finished" for state in states.values())
        progress(f"{done} of {len(states)} trainings finished", done / len(states))

    runs = planned(folders, seeds, device=None if device == "auto" else device, **limits)
    train_all(runs, parallel * training_devices(device), RETRIES, watch)


def planned(folders: Sequence[Path], seeds: int, **limits: Any) -> list[SweptRun]:
    """The trainings seed by seed: a sweep that is cut short has trained every design."""
    methods = tuple(METHODS.values())
    return [
        replace(run, name=f"{folder.name} {run.name}", words=(*run.words, "--plain"))
        for seed in range(seeds)
        for folder in folders
        for run in plan_sweep(folder, robot=str(folder), methods=methods, seeds=[seed], **limits)
    ]


def policies_of(folder: Path, model: MotorModel) -> list[Path]:
    """The finished policies of a design that were trained under a motor model."""
    return sorted((folder / METHODS[model]).glob("seed-*/policy.onnx"))


def judge_designs(
    folders: Sequence[Path], processes: WorkerProcesses, progress: Progress
) -> list[dict[str, dict[str, float]]]:
    """What every design's policies hold, by the motor model that they were trained under.

    Each policy is judged by the refined motor and by its own, which is what its designer believes.

    Returns:
        For each design means over its seeds; nothing where a motor model has no policy yet.
    """
    tasks: list[tuple[Path, MotorModel]] = [
        (policy, judge)
        for folder in folders
        for model in MODELS
        for policy in policies_of(folder, model)
        for judge in dict.fromkeys((MODELS[0], model))
    ]
    found: dict[tuple[Path, MotorModel], dict[str, float]] = {}
    for task, numbers in zip(tasks, processes.map(judged, tasks), strict=True):
        found[task] = numbers
        progress(f"{len(found)} of {len(tasks)} judgements of policies", len(found) / len(tasks))
    return [_by_model(folder, found) for folder in folders]


def _by_model(
    folder: Path, found: Mapping[tuple[Path, MotorModel], Mapping[str, float]]
) -> dict[str, dict[str, float]]:
    policies: dict[MotorModel, list[Path]] = {model: policies_of(folder, model) for model in MODELS}
    if not all(policies.values()):
        return {}
    numbers = dict[str, dict[str, float]]()
    for model, group in policies.items():
        refined = [found[policy, MODELS[0]] for policy in group]
        numbers[model] = {name: float(np.mean([each[name] for each in refined])) for name in refined[0]}
        numbers[model] |= {
            "believed_m_s": float(np.mean([found[policy, model]["speed_m_s"] for policy in group])),
            "spread_m_s": float(np.ptp([each["speed_m_s"] for each in refined])),
            "seeds": len(group),
        }
    return numbers


def judged(task: tuple[Path, MotorModel]) -> dict[str, float]:
    """Speed, power and winding temperature of a policy with a motor model, computed where missing."""
    policy, model = task
    path, digest = policy.with_name(f"judged-{model}.json"), file_sha256(policy)
    record = read_json(path, what="record") if path.is_file() else {}
    if record.get("policy_sha256") != digest:
        settings = replace(JUDGE, plant=PlantOptions(motor_model=model))
        with TrialPool(policy, load_robot_file(policy.parents[2] / "parameters.toml"), 1) as pool:
            speeds = run_protocol_near(LIKELY, pool, settings).speeds
            ran = (speed for speed in speeds if speed.ran)
            best = max(ran, key=lambda speed: speed.running_speed, default=None)
            numbers = NOT_RUNNING if best is None else _numbers(best, pool, settings)
        record = {"policy_sha256": digest, "numbers": numbers}
        atomic_write_json(path, json_ready(record))
    return {name: np.nan if value is None else value for name, value in record["numbers"].items()}


NOT_RUNNING = {"speed_m_s": 0.0, "power_W": np.nan, "winding_degC": np.nan}
"""Of a policy that falls at the lowest speed."""


def _numbers(best: SpeedResult, pool: TrialPool, settings: ProtocolSettings) -> dict[str, float]:
    """Means of speed and power over the upright trials, temperature of one trial with warm windings."""
    upright = [trial.metrics for trial in best.trials if not trial.fall_reason]
    request = settings.requests(best.top_speed, self_paced=False)[0]
    (warm,) = pool.trials([replace(request, plant=replace(settings.plant, heat=WindingHeat()))])
    return {
        "speed_m_s": best.running_speed,
        "power_W": float(np.mean([metrics.electrical_power for metrics in upright])),
        "winding_degC": warm.metrics.hottest_winding or np.nan,
    }
