"""Where finished runs lie: ``<folder>/<method>/seed-<k>/`` with a policy, an evaluation, or both."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from sprintlab.core.errors import SprintlabError
from sprintlab.core.reading import check_folder
from studies.paper.paper import PAPER_TABLE
from studies.paper.record import EvaluationRecord, read_evaluation

POLICY_NAME = "policy.onnx"
EVALUATION_NAME = "evaluation.json"
CHECKPOINT_NAME = "checkpoint.pt"
CLOUD_NAME = "cloud.npz"
SEED_FOLDER = re.compile(r"seed-(\d{1,9})")
"""Name of a run's folder."""
_METHOD = re.compile(r"[\w.+-]{1,60}")  # it stands on a page


@dataclass(frozen=True, kw_only=True)
class Run:
    """One training run.

    Attributes:
        method: name of its method's folder.
        seed: from the name of its folder.
        folder: where its files lie.
    """

    method: str
    seed: int
    folder: Path

    @property
    def policy(self) -> Path:
        """The policy file, which need not exist."""
        return self.folder / POLICY_NAME

    @property
    def evaluation(self) -> Path:
        """The evaluation, which need not exist."""
        return self.folder / EVALUATION_NAME

    @property
    def checkpoint(self) -> Path:
        """The last checkpoint, which need not exist."""
        return self.folder / CHECKPOINT_NAME

    @property
    def cloud(self) -> Path:
        """Where the motors of the training worked, which need not exist."""
        return self.folder / CLOUD_NAME


def find_runs(folder: Path) -> list[Run]:
    """Every run below a folder, the paper's methods first and in its order.

    Raises:
        SprintlabError: the folder does not exist or holds no runs, a method's name has other signs, or a
            run lies behind a link.
    """
    check_folder(folder)
    runs = [
        Run(method=place.parent.name, seed=int(match.group(1)), folder=place)
        for place in folder.glob("*/*")
        if place.is_dir() and (match := SEED_FOLDER.fullmatch(place.name))
    ]
    if not runs:
        raise SprintlabError(f"{folder} holds no runs; they are expected as {folder}/<method>/seed-<number>/")
    for run in runs:
        if not _METHOD.fullmatch(run.method):
            raise SprintlabError(
                f"{run.folder.parent}: a method's name has letters, digits, _, ., + and - only"
            )
        check_own_folder(run.folder)
    return sorted(runs, key=lambda run: (*_place(run.method), run.seed))


def check_own_folder(folder: Path) -> None:
    """Refuse a run's folder that a link leads elsewhere: what is written there, or removed, is not the run's.

    Args:
        folder: ``<method>/seed-<k>``, which need not exist. What lies above both may be a link.

    Raises:
        SprintlabError: it, or its method's folder, is a link.
    """
    for place in (folder.parent, folder):
        if place.is_symlink():
            raise SprintlabError(f"{place} is a link: a run and its method have folders of their own")


def committed_records(runs: Iterable[Run]) -> list[EvaluationRecord]:
    """The evaluations of the runs that have one; errors as in ``read_evaluation``."""
    return [read_evaluation(run.evaluation) for run in runs if run.evaluation.is_file()]


def readable_records(runs: Iterable[Run]) -> list[EvaluationRecord]:
    """The evaluations that can be read; a damaged one, or one of another version, counts as none."""
    records: list[EvaluationRecord] = []
    for run in runs:
        with suppress(SprintlabError):
            records.append(read_evaluation(run.evaluation))
    return records


def by_method(records: Sequence[EvaluationRecord]) -> dict[str, list[EvaluationRecord]]:
    """Records by method, all of the paper's methods first, even those without a record."""
    grouped: dict[str, list[EvaluationRecord]] = {method: [] for method in PAPER_TABLE}
    for record in sorted(records, key=lambda record: (*_place(record.method), record.seed)):
        grouped.setdefault(record.method, []).append(record)
    return grouped


def _place(method: str) -> tuple[int, str]:
    """Where a method stands: the paper's order, then the alphabet."""
    known = list(PAPER_TABLE)
    return (known.index(method) if method in known else len(known)), method
