"""Many runs that differ in one thing or in all: robustness, slopes and rough ground, turning.

A sweep is a list of cases. Each is run in a worker process and comes back as one row of plain values, which
may be kept in a folder, a file a row, so that a kill loses only what was being computed.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from sprintlab.control import Policy
from sprintlab.core.errors import SprintlabError
from sprintlab.core.files import atomic_write_json, check_writable
from sprintlab.core.json_values import json_ready
from sprintlab.core.reading import JSON_LIMIT, read_bytes, read_json
from sprintlab.evaluation.pool import TrialPool, run_request
from sprintlab.evaluation.results import SprintResult, Trajectory
from sprintlab.evaluation.trial import Course, TrialRequest, run_course
from sprintlab.robots import RobotDescription

Progress = Callable[[str, int, int], None]
"""Told after every run its group, how many are done, and of how many."""

TURN_WINDOW = 2.0
"""A turn is measured over its last part [s]."""

_IDENTITY = "study.json"


@dataclass(frozen=True, kw_only=True)
class Case:
    """One run of a sweep."""

    group: str  # under which it counts
    request: TrialRequest  # a profile, or a sprint where it has a distance
    course: Course | None = None  # run instead of either


class Run(msgspec.Struct, frozen=True, kw_only=True):
    """How one run of a sweep ended; what is not defined is None."""

    group: str  # under which it counts
    seed: int  # decides its draws
    fall_reason: str  # empty where it did not fall
    fall_time_s: float | None
    held_speed_m_s: float | None  # last 2 s of the hold, of a sprint before the line, of a turn at its end
    distance_m: float  # forward distance of the base
    time_s: float | None = None  # from the first command to the line of a sprint
    left_lane: bool = False  # whether a foot left the lane of a sprint
    yaw_rate_rad_s: float | None = None  # mean over the last 2 s of a turn
    drawn: dict[str, Any] = msgspec.field(default_factory=dict)  # what was drawn for it

    @property
    def upright(self) -> bool:
        """Whether it did not fall from start to end."""
        return not self.fall_reason


def run_case(policy: Policy, robot: RobotDescription, case: Case) -> Run:
    """Run one case; errors as in ``run_trial``."""
    request, course = case.request, case.course
    found = (
        run_request(policy, robot, request) if course is None else run_course(policy, robot, request, course)
    )
    sprint = found if isinstance(found, SprintResult) else None
    trial = found.trial if isinstance(found, SprintResult) else found
    speed, yaw_rate = trial.metrics.held_speed, math.nan
    if course is not None and trial.trajectory is not None and not trial.fall_reason:
        speed, yaw_rate = achieved(trial.trajectory)
    plant = {"bus_voltage": request.plant.bus_voltage, "foot": asdict(request.plant.foot)}
    return Run(
        group=case.group,
        seed=request.settings.seed,
        fall_reason=trial.fall_reason,
        fall_time_s=trial.fall_time,
        held_speed_m_s=json_ready(speed),
        distance_m=trial.metrics.distance,
        time_s=json_ready(math.nan if sprint is None else sprint.time),
        left_lane=sprint is not None and sprint.left_lane,
        yaw_rate_rad_s=json_ready(yaw_rate),
        drawn=json_ready({**asdict(request.settings), **plant}),
    )


def achieved(trajectory: Trajectory) -> tuple[float, float]:
    """Mean forward speed [m/s] and yaw rate [rad/s] over the last 2 s."""
    last = trajectory.time >= trajectory.time[-1] - TURN_WINDOW
    time, heading = trajectory.time[last], trajectory.heading[last]
    rate = (heading[-1] - heading[0]) / (time[-1] - time[0])
    return float(trajectory.velocity[last, 0].mean()), float(rate)


def run_cases(
    pool: TrialPool, cases: Sequence[Case], progress: Progress = lambda *_: None, folder: Path | None = None
) -> list[Run]:
    """Run what is not in the folder yet, in the order of the cases; None keeps no files.

    Raises:
        SprintlabError: a file in the folder cannot be read, or the disk refuses.
        SimulationError: as ``run_trial``.
    """
    kept = [_read(folder, case) for case in cases]
    missing = [index for index, run in enumerate(kept) if run is None]
    with closing(pool.map(run_case, [cases[index] for index in missing])) as found:
        for done, (index, run) in enumerate(zip(missing, found, strict=True), start=1):
            kept[index] = run
            if folder is not None:
                atomic_write_json(_path(folder, cases[index]), msgspec.to_builtins(run))
            progress(run.group, len(cases) - len(missing) + done, len(cases))
    return [run for run in kept if run is not None]


def of_group(runs: Sequence[Run], group: str) -> list[Run]:
    """The runs that count under a group."""
    return [run for run in runs if run.group == group]


def held_speeds(runs: Sequence[Run]) -> list[float]:
    """Held speeds [m/s] of the upright runs that came so far."""
    return [run.held_speed_m_s for run in runs if run.upright and run.held_speed_m_s is not None]


def mean(values: Sequence[float]) -> float:
    """Mean; ``nan`` of nothing."""
    return float(np.mean(values)) if values else math.nan


def stored_study(folder: Path) -> dict[str, Any]:
    """What the study in a folder says of itself; empty where a study may begin.

    Raises:
        SprintlabError: it is not a folder, holds something else, or nothing can be written there.
    """
    identity = folder / _IDENTITY
    if os.path.lexists(folder) and not folder.is_dir():
        raise SprintlabError(f"{folder} is no folder; choose another one for the sprints")
    check_writable(identity)
    if identity.exists():
        found = read_json(identity, what="study")
        if isinstance(found, dict) and isinstance(found.get("top_speed"), float):
            return found
        raise SprintlabError(f"{identity} tells of no study; choose another folder for the sprints")
    if folder.exists() and any(folder.iterdir()):
        raise SprintlabError(f"{folder} holds other files; choose another folder for the sprints")
    return {}


def claim_folder(folder: Path, identity: dict[str, Any]) -> None:
    """Make the folder this study's, or see that it is already.

    Raises:
        SprintlabError: it belongs to another one, or cannot be a study's.
    """
    stored = stored_study(folder)
    if other := [name for name, value in identity.items() if stored and stored.get(name) != value]:
        raise SprintlabError(
            f"{folder} holds a study with another {' and '.join(other)}; choose another folder"
        )
    if not stored:
        atomic_write_json(folder / _IDENTITY, identity)


def _path(folder: Path, case: Case) -> Path:
    return folder / f"{case.group.replace(' ', '-')}-{case.request.settings.seed:06d}.json"


def _read(folder: Path | None, case: Case) -> Run | None:
    """A run that was kept before; None where it was not. Raises ``SprintlabError`` for another file."""
    if folder is None or not (path := _path(folder, case)).exists():
        return None
    try:
        return msgspec.json.decode(read_bytes(path, JSON_LIMIT, what="sprint"), type=Run)
    except (SprintlabError, msgspec.DecodeError) as error:
        raise SprintlabError(f"{path}: {error}; remove it and run again") from error
