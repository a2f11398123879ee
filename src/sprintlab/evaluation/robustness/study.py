"""Runs the sprints of a study side by side and keeps each in a file of its own, so that a kill loses none."""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import closing
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from sprintlab.core.checks import check_range
from sprintlab.core.errors import SprintlabError
from sprintlab.core.files import atomic_write_json, check_writable
from sprintlab.core.json_values import json_ready
from sprintlab.core.reading import read_json
from sprintlab.evaluation.pool import TrialPool
from sprintlab.evaluation.results import SprintResult, TrialResult
from sprintlab.evaluation.robustness.draws import ALL, CAUSES, NOMINAL, RobustnessRanges, draw_request
from sprintlab.evaluation.trial import TrialRequest, check_sprint, check_top_speed
from sprintlab.plant import PlantOptions

Piece = dict[str, Any]
"""One sprint as plain values: group, seed, what was drawn, how it ended."""

Progress = Callable[[int, int], None]
"""Told how many sprints are done, of how many."""

_RECORD_RATE = 100.0  # enough for speeds and falls, and cheaper than the audit's 500 Hz [Hz]
_IDENTITY = "study.json"
_LARGEST = 1e6  # [s], [m/s]: sums of more could be infinite
_KINDS: dict[str, Any] = {
    **dict.fromkeys(("upright", "left_lane"), bool),
    "fall_reason": str,
}
_NUMBERS = ("time_s", "held_speed_m_s")


@dataclass(frozen=True, kw_only=True)
class StudySettings:
    """What is run.

    Attributes:
        top_speed: v* of every sprint [m/s].
        trials: sprints with everything randomized at once.
        cause_trials: sprints of each cause alone, and of the nominal robot.
        distance: of each sprint [m].
        seed: of the first sprint; the next one has the next seed.
        ranges: what is drawn from.

    Raises:
        InvalidValueError: a number is out of range.
    """

    top_speed: float
    trials: int = 1000
    cause_trials: int = 20
    distance: float = 100.0
    seed: int = 0
    ranges: RobustnessRanges = field(default_factory=RobustnessRanges)

    def __post_init__(self) -> None:
        check_top_speed("robustness.top_speed", self.top_speed)
        check_range("robustness.trials", self.trials, 1, 1_000_000)
        check_range("robustness.cause_trials", self.cause_trials, 0, 1_000_000)
        check_sprint("robustness.distance", self.distance, self.top_speed)
        check_range("robustness.seed", self.seed, 0, 2**31)

    def sprints(self) -> list[tuple[str, int]]:
        """Group and seed of every sprint, in the order in which they are run."""
        alone = [(group, trial) for group in (NOMINAL, *CAUSES) for trial in range(self.cause_trials)]
        together = [(ALL, trial) for trial in range(self.trials)]
        return [(group, self.seed + trial) for group, trial in (*alone, *together)]


def run_study(
    pool: TrialPool, settings: StudySettings, folder: Path, progress: Progress = lambda *_: None
) -> list[Piece]:
    """Run what is not in the folder yet.

    Args:
        pool: policy, robot and processes; the hash of the policy's file names the study.
        settings: what is run; more ``trials`` than before go on with the same study.
        folder: one file a sprint is written here; made where it is missing.
        progress: called after every sprint.

    Returns:
        The sprints, in the order of ``settings.sprints()``.

    Raises:
        SprintlabError: the folder holds another study, or the disk refuses.
        SimulationError: as ``run_sprint``.
    """
    check_identity(folder, _identity(pool, settings))
    wanted = settings.sprints()
    known = {(group, seed): _read(folder, group, seed) for group, seed in wanted}
    missing = [sprint for sprint, piece in known.items() if piece is None]
    requests = [_request(group, seed, settings, pool.robot.bus_voltage) for group, seed in missing]
    progress(len(wanted) - len(missing), len(wanted))
    with closing(pool.stream(requests)) as results:
        for done, ((group, seed), request, result) in enumerate(
            zip(missing, requests, results, strict=True), start=len(wanted) - len(missing) + 1
        ):
            known[group, seed] = piece = _piece(group, seed, request, result)
            atomic_write_json(_path(folder, group, seed), piece)
            progress(done, len(wanted))
    return [piece for piece in known.values() if piece is not None]


def check_folder(folder: Path) -> None:
    """Refuse, before any work, a folder that cannot be a study's.

    Raises:
        SprintlabError: it is no folder, holds something else, or nothing can be written there.
    """
    if os.path.lexists(folder) and not folder.is_dir():
        raise SprintlabError(f"{folder} is no folder; choose another one for the sprints")
    check_writable(folder / _IDENTITY)
    named = (folder / _IDENTITY).exists()
    if named and known_top_speed(folder) is None:
        raise SprintlabError(f"{folder / _IDENTITY} tells of no study; choose another folder for the sprints")
    if not named and folder.exists() and any(folder.iterdir()):
        raise SprintlabError(f"{folder} holds other files; choose another folder for the sprints")


def check_identity(folder: Path, identity: dict[str, Any]) -> None:
    """Make the folder this study's, or see that it is already.

    Raises:
        SprintlabError: it belongs to another one, or cannot be a study's.
    """
    path = folder / _IDENTITY
    if not path.exists():
        check_folder(folder)
        atomic_write_json(path, identity)
        return
    found = read_json(path, what="study")
    same = found if isinstance(found, dict) else {}
    other = [name for name, value in identity.items() if same.get(name) != value]
    if other:
        raise SprintlabError(
            f"{folder} holds a study with another {' and '.join(other)}; choose another folder"
        )


def known_top_speed(folder: Path) -> float | None:
    """The command [m/s] of the study in a folder; ``None`` where there is none."""
    try:
        return float(read_json(folder / _IDENTITY)["top_speed"])
    except (SprintlabError, ValueError, TypeError, KeyError):
        return None


def _identity(pool: TrialPool, settings: StudySettings) -> dict[str, Any]:
    return {
        "policy": pool.policy.digest,
        "robot": pool.robot.name,
        "top_speed": settings.top_speed,
        "distance": settings.distance,
        "ranges": json_ready(asdict(settings.ranges)),
    }


def _request(group: str, seed: int, settings: StudySettings, bus_voltage: float) -> TrialRequest:
    return draw_request(
        seed,
        group,
        top_speed=settings.top_speed,
        bus_voltage=bus_voltage,
        distance=settings.distance,
        ranges=settings.ranges,
        plant=PlantOptions(record_rate=_RECORD_RATE),
    )


def _path(folder: Path, group: str, seed: int) -> Path:
    return folder / f"{group.replace(' ', '-')}-{seed:06d}.json"


def _read(folder: Path, group: str, seed: int) -> Piece | None:
    """A sprint that was run before; ``None`` where it was not.

    Raises:
        SprintlabError: its file cannot be read.
    """
    path = _path(folder, group, seed)
    if not path.exists():
        return None
    try:
        piece = read_json(path, what="sprint")
    except SprintlabError as error:
        raise SprintlabError(f"{error}; remove it and run again") from error
    ours = isinstance(piece, dict) and (piece.get("group"), piece.get("seed")) == (group, seed)
    if not ours or not _is_sprint(piece):
        raise SprintlabError(f"{path} is no sprint of this study; remove it and run again")
    return piece


def _is_sprint(piece: Piece) -> bool:
    kinds = all(isinstance(piece.get(name), kind) for name, kind in _KINDS.items())
    return kinds and all(name in piece and _is_number(piece[name]) for name in _NUMBERS)


def _is_number(value: Any) -> bool:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return value is None or (number and abs(value) <= _LARGEST)


def _piece(group: str, seed: int, request: TrialRequest, result: TrialResult | SprintResult) -> Piece:
    assert isinstance(result, SprintResult)
    trial = result.trial
    return json_ready(
        {
            "group": group,
            "seed": seed,
            "upright": not trial.fall_reason,
            "fall_reason": trial.fall_reason,
            "fall_time_s": trial.fall_time,
            "time_s": result.time,
            "left_lane": result.left_lane,
            "held_speed_m_s": trial.metrics.held_speed,
            "distance_m": trial.metrics.distance,
            "drawn": {
                **asdict(request.settings),
                "bus_voltage": request.plant.bus_voltage,
                "foot": asdict(request.plant.foot),
            },
        }
    )
