"""One run of the study in one small JSON file: what a policy held, how it stopped, what the audit says."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import msgspec

from sprintlab.core.errors import SprintlabError
from sprintlab.core.files import atomic_write_bytes
from sprintlab.core.reading import read_bytes

RESULTS = Path(__file__).parent / "results"
RECORD_LIMIT = 1 << 20
"""Largest record that is read [bytes]; those of the study have a few kB."""
NOMINAL, DRAKE = "bp2", "drake"
PLACES = (NOMINAL, "bp2-weak", "bp2-strong", DRAKE)
"""Where policies run: editions of the robot in MuJoCo, and the nominal robot in Drake."""
PRESETS = ("sprintlab", "paper")
"""Our reward table, and the paper's to the letter."""


class Command(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The seeded trials of one commanded speed, given as it is.

    Attributes:
        speed: v* [m/s].
        trials: how many ran; up to the first fall, which decides.
        upright: how many did not fall from start to end.
        completed: how many did not fall and were at rest in the last second.
        held: mean speed over the last 2 s of the hold, of the upright trials [m/s].
        audit_failed: lines of the audit that fail, but for the policy clock's, which wants trials of its own.
    """

    speed: float
    trials: int
    upright: int
    completed: int
    held: float | None
    audit_failed: int

    def all_kept(self, count: int) -> bool:
        """Whether every trial is in ``count``."""
        return count == self.trials > 0

    @property
    def clean(self) -> bool:
        """Whether every trial stays upright and the audit passes."""
        return self.audit_failed == 0 and self.all_kept(self.upright)


class Fastest(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Means over the completed trials of the command at which most speed is held, on the nominal robot.

    Attributes:
        speed: v* [m/s].
        angular_cost: J [rad^2/s].
        stride_frequency: [Hz].
        sprint_time: 100 m, raw command [s]; ``None`` when the line was not reached.
        audit_failed: names of the audit's lines that failed.
    """

    speed: float
    angular_cost: float | None
    stride_frequency: float | None
    sprint_time: float | None
    audit_failed: tuple[str, ...]


class Run(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Everything that the study keeps of one training.

    Attributes:
        method: method of the training.
        preset: reward table, one of ``PRESETS``.
        seed: seed of the training.
        command_line: that trained it.
        environment_steps: policy steps of all robots in the training.
        policy_sha256: of the policy file.
        date: date of the evaluation, ISO 8601.
        versions: versions of the packages that evaluated it.
        places: every commanded speed that was tried, rising, by name in ``PLACES``.
        fastest: details at the command at which most is held; ``None`` where nothing completed.
    """

    method: str
    preset: str
    seed: int
    command_line: str
    environment_steps: int
    policy_sha256: str
    date: str
    versions: dict[str, str]
    places: dict[str, tuple[Command, ...]]
    fastest: Fastest | None

    def running(self, place: str = NOMINAL) -> float:
        """Most speed held at a command at which every trial stays upright [m/s]; 0 without one.

        ``nan`` where the policy did not run there.
        """
        commands = self.places.get(place)
        if commands is None:
            return math.nan
        return max((_held(each) for each in commands if each.all_kept(each.upright)), default=0.0)

    def stopping(self) -> float:
        """Most speed held up to the first command from which a trial does not come to rest [m/s]."""
        speeds = [0.0]
        for each in self.places[NOMINAL]:
            if not each.all_kept(each.completed):
                break
            speeds.append(_held(each))
        return max(speeds)

    def audited(self) -> float:
        """Most speed held where every trial stays upright and the audit passes [m/s]; 0 without one."""
        return max((_held(each) for each in self.places[NOMINAL] if each.clean), default=0.0)


def _held(command: Command) -> float:
    return 0.0 if command.held is None or math.isnan(command.held) else command.held


Runs = Mapping[tuple[str, str], Sequence[Run]]
"""(preset, method) to its runs by seed."""


def record_path(results: Path, preset: str, method: str, seed: int) -> Path:
    """Where the record of a run lies."""
    return results / preset / method / f"seed-{seed}.json"


def write_run(results: Path, run: Run) -> Path:
    """Write a record in one step; raises ``SprintlabError`` where the disk refuses."""
    path = record_path(results, run.preset, run.method, run.seed)
    atomic_write_bytes(path, msgspec.json.encode(run) + b"\n")
    return path


def read_run(path: Path) -> Run:
    """Inverse of ``write_run``.

    Raises:
        SprintlabError: the file is missing or is not a record of this version.
    """
    try:
        return msgspec.json.decode(read_bytes(path, RECORD_LIMIT, what="record"), type=Run)
    except msgspec.DecodeError as error:
        raise SprintlabError(f"{path} is not a record of the study: {error}") from error


def read_runs(results: Path) -> Runs:
    """Every record below a folder by preset and method; errors as in ``read_run``."""
    found: dict[tuple[str, str], list[Run]] = {}
    for run in map(read_run, sorted(results.glob("*/*/seed-*.json"))):
        found.setdefault((run.preset, run.method), []).append(run)
    return {key: sorted(group, key=lambda run: run.seed) for key, group in found.items()}


def _all(_: Run) -> bool:
    return True


def median_run(group: Sequence[Run], able: Callable[[Run], bool] = _all) -> Run | None:
    """The run in the middle by running speed, the slower of two; if it is not able, the nearest that is."""
    ranked = sorted(group, key=lambda run: (run.running(), run.seed))
    middle = (len(ranked) - 1) // 2
    places = sorted(range(len(ranked)), key=lambda place: (abs(place - middle), place))
    return next((ranked[place] for place in places if able(ranked[place])), None)


def best_half(group: Sequence[Run], able: Callable[[Run], bool]) -> list[Run]:
    """As many runs as half of the group, rounded up: the fastest of those that are able."""
    ranked = sorted(filter(able, group), key=lambda run: (-run.running(), run.seed))
    return ranked[: (len(group) + 1) // 2]
