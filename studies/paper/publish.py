"""Put finished and evaluated runs where they are committed; a policy only of each method's median seed.

    python -m studies.paper table runs/study
    python -m studies.paper publish runs/study

The median seed of a method is the one in the middle by the most that is held with the raw command (the
slower of two in the middle), among those that did not collapse if there are any. With it goes the cloud.npz
of its training, for the figures, where there is one.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import tyro

from sprintlab.core.errors import SprintlabError
from sprintlab.core.files import atomic_write_bytes, atomic_write_text
from sprintlab.core.reading import read_bytes, read_lines, read_rows
from studies.paper.gallery import CURVE_LIMIT, CURVE_NAME
from studies.paper.record import EvaluationRecord, read_evaluation
from studies.paper.runs import (
    CLOUD_NAME,
    EVALUATION_NAME,
    POLICY_NAME,
    SEED_FOLDER,
    Run,
    check_own_folder,
    find_runs,
)

LOG_NAME = "log.jsonl"
KEPT = ("run.toml", "run.json", EVALUATION_NAME)
COPY_LIMIT, LOG_LIMIT = 64 << 20, 64 << 20
"""Largest files that are copied or thinned [bytes]."""
CURVE_ROWS = 100
"""About so many rows of a learning curve are kept: whole, a run's has 350 kB."""


@dataclass(frozen=True, kw_only=True)
class Publish:
    """Where from and where to.

    Attributes:
        runs: folder of finished runs, each with a policy and its evaluation.
        results: folder of the small files, and of the median seeds' policies.
    """

    runs: tyro.conf.Positional[Path]
    results: Path = Path("studies/paper/results")

    def run(self) -> int:
        """Copy and print the policies that were kept; errors as in ``publish``."""
        for path in publish(self):
            print(path)
        return 0


def publish(options: Publish) -> list[Path]:
    """Copy; returns the policies that were written.

    Raises:
        SprintlabError: a run has no evaluation or no policy, or a folder of the results is a link: nothing is
            copied; or the disk refuses.
    """
    ranked: dict[str, list[tuple[EvaluationRecord, Run]]] = {}
    runs = find_runs(options.runs)
    missing = [str(run.folder) for run in runs if not (run.policy.is_file() and run.evaluation.is_file())]
    if missing:
        raise SprintlabError(
            f"no policy or evaluation in {', '.join(missing)}: run 'python -m studies.paper table' first"
        )
    for folder in (options.results / run.method / run.folder.name for run in runs):
        check_own_folder(folder)
    for run in runs:
        record = read_evaluation(run.evaluation)
        _copy_small_files(run, options.results / run.method / run.folder.name)
        ranked.setdefault(run.method, []).append((record, run))
    sources = {os.path.realpath(path) for one in runs for path in (one.cloud, one.policy)}
    medians = [_median(group) for group in ranked.values()]
    return [_publish_median(run, options.results / run.method, sources) for run in medians]


def _median(group: list[tuple[EvaluationRecord, Run]]) -> Run:
    """The run in the middle by speed, the slower of two; what collapsed has no gait to draw or run again."""
    running = [item for item in group if not item[0].raw.collapsed] or group
    return sorted(running, key=lambda item: _speed(item[0]))[(len(running) - 1) // 2][1]


def _publish_median(run: Run, folder: Path, sources: set[str]) -> Path:
    """Keep policy and cloud of a method's median run, and no other run's: they are the large files."""
    for name in (CLOUD_NAME, POLICY_NAME):
        for old in folder.glob(f"*/{name}"):
            ours = SEED_FOLDER.fullmatch(old.parent.name) and not old.parent.is_symlink()
            if ours and os.path.realpath(old) not in sources:
                old.unlink()
    place = folder / run.folder.name
    if run.cloud.is_file():
        _copy(run.cloud, place / CLOUD_NAME)
    return _copy(run.policy, place / POLICY_NAME)


def _speed(record: EvaluationRecord) -> float:
    """The most that is held, raw [m/s]; a policy that runs nowhere comes last."""
    speed = record.raw.most_held
    return speed if speed == speed else -1.0


def _copy_small_files(run: Run, folder: Path) -> None:
    for name in KEPT:
        if (run.folder / name).is_file():
            _copy(run.folder / name, folder / name)
    if (run.folder / CURVE_NAME).is_file():
        atomic_write_text(
            folder / CURVE_NAME,
            _thinned(read_lines(_own(run.folder / CURVE_NAME), CURVE_LIMIT, "learning curve")),
        )
    elif (run.folder / LOG_NAME).is_file():
        atomic_write_text(
            folder / CURVE_NAME, _thinned(_curve(run.folder / LOG_NAME).splitlines(keepends=True))
        )


def _thinned(curve: list[str]) -> str:
    """About ``CURVE_ROWS`` rows and the last; a curve that was thinned before stays as it is."""
    header, *rows = curve or [""]
    step = max(1, len(rows) // CURVE_ROWS)
    return "".join([header, *rows[: len(rows) - 1 : step], *rows[-1:]])


def _curve(log: Path) -> str:
    """The learning curve that a sweep would have written."""
    from sprintlab.training.runs.sweep import curve_text

    return curve_text(read_rows(_own(log), LOG_LIMIT))


def _copy(source: Path, target: Path) -> Path:
    atomic_write_bytes(target, read_bytes(_own(source), COPY_LIMIT))
    return target


def _own(source: Path) -> Path:
    """A file of the run itself: what a link points to may be anything, and would be published."""
    if source.is_symlink():
        raise SprintlabError(f"{source} is a link: only files of the run itself are published")
    return source
