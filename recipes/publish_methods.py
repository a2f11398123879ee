"""Put finished and evaluated runs where they are committed: small files by run, the best policy by method.

    sprintlab ablate runs/methods
    python recipes/publish_methods.py runs/methods
    sprintlab ablate results/methods --recorded --markdown docs/results.md
    sprintlab figures --markdown docs/results.md

Runs come from "sprintlab sweep", or from "sprintlab train" with --output runs/methods/<method>/seed-<number>:
the latter have no curve.csv, which is then made of their log.jsonl.

The best policy of a method is the one with the highest raw max velocity; one that fails the exploit audit is
taken only where none passes it. A gait timed by the policy's clock that runs as well with other clocks counts
as passing. With it comes the cloud.npz of its training, for the figures, where there is one.
"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path

import tyro

from sprintlab.core.errors import SprintlabError
from sprintlab.core.files import atomic_write_bytes, atomic_write_text
from sprintlab.evaluation.ablation.gallery import CURVE_NAME
from sprintlab.evaluation.ablation.record import EvaluationRecord, read_evaluation
from sprintlab.evaluation.ablation.runs import CLOUD_NAME, EVALUATION_NAME, Run, find_runs

LOG_NAME = "log.jsonl"
KEPT = ("settings.json", "run.json", EVALUATION_NAME)
CURVE_ROWS = 100
"""About so many rows of a learning curve are kept: whole, a run's has 350 kB."""
POLICIES = Path("src/sprintlab/control/policies/methods")


@dataclass(frozen=True, kw_only=True)
class Options:
    """Where from and where to.

    Attributes:
        runs: folder of finished runs, each with a policy and its evaluation.
        results: folder of the small files.
        policies: folder of the policies that come with the package.
    """

    runs: tyro.conf.Positional[Path]
    results: Path = Path("results/methods")
    policies: Path = POLICIES


def publish(options: Options) -> list[Path]:
    """Copy; returns the policies that were written.

    Raises:
        SprintlabError: a run has no evaluation or no policy, and nothing is copied; or the disk refuses.
    """
    best: dict[str, tuple[tuple[bool, float], Run]] = {}
    runs = find_runs(options.runs)
    missing = [str(run.folder) for run in runs if not (run.policy.is_file() and run.evaluation.is_file())]
    if missing:
        raise SprintlabError(f"no policy or evaluation in {', '.join(missing)}: run sprintlab ablate first")
    for run in runs:
        record = read_evaluation(run.evaluation)
        _copy_small_files(run, options.results / run.method / run.folder.name)
        rank = _rank(record)
        if run.method not in best or rank > best[run.method][0]:
            best[run.method] = (rank, run)
    for _, run in best.values():
        _publish_cloud(run, options.results / run.method, {one.cloud.resolve() for one in runs})
    return [_copy(run.policy, options.policies / f"{method}.onnx") for method, (_, run) in best.items()]


def _publish_cloud(run: Run, folder: Path, sources: set[Path]) -> None:
    """Keep the cloud of the best run of a method, and no other: each has some 150 kB."""
    for old in folder.glob(f"*/{CLOUD_NAME}"):
        if old.resolve() not in sources:
            old.unlink()
    if run.cloud.is_file():
        _copy(run.cloud, folder / run.folder.name / CLOUD_NAME)


def _rank(record: EvaluationRecord) -> tuple[bool, float]:
    """Whether it is honest, then the speed; a policy that runs nowhere comes last."""
    speed = record.raw.max_velocity
    return record.honest, speed if speed == speed else -1.0


def _copy_small_files(run: Run, folder: Path) -> None:
    for name in KEPT:
        if (run.folder / name).is_file():
            _copy(run.folder / name, folder / name)
    if (run.folder / CURVE_NAME).is_file():
        atomic_write_text(
            folder / CURVE_NAME, _thinned((run.folder / CURVE_NAME).read_text(encoding="utf-8"))
        )
    elif (run.folder / LOG_NAME).is_file():
        atomic_write_text(folder / CURVE_NAME, _thinned(_curve(run.folder / LOG_NAME)))


def _thinned(curve: str) -> str:
    """Every so manieth row, and the last: a curve that was thinned before stays as it is."""
    header, *rows = curve.splitlines(keepends=True)
    step = max(1, len(rows) // CURVE_ROWS)
    return "".join([header, *rows[: len(rows) - 1 : step], *rows[-1:]])


def _curve(log: Path) -> str:
    """The learning curve that a sweep would have written."""
    from sprintlab.training.sweep import curve_text

    try:
        return curve_text([json.loads(line) for line in log.read_text(encoding="utf-8").splitlines()])
    except (OSError, ValueError) as error:
        raise SprintlabError(f"{log} is no training log: {error}") from error


def _copy(source: Path, target: Path) -> Path:
    try:
        atomic_write_bytes(target, source.read_bytes())
    except OSError as error:
        raise SprintlabError(f"cannot copy {source}: {error.strerror or error}") from error
    return target


if __name__ == "__main__":
    try:
        for path in publish(tyro.cli(Options)):
            print(path)
    except SprintlabError as error:
        sys.exit(str(error))
