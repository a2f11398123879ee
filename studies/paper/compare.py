"""``python -m studies.paper table``: the methods side by side, the paper's Table II beside ours."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tyro

from sprintlab.api.search import SearchOptions
from sprintlab.cli.output import plain_table, print_json, progress_bar, stderr_console, stdout_console
from sprintlab.core.errors import SprintlabError

if TYPE_CHECKING:
    from studies.paper.measure import Candidate, EvaluationPlan
    from studies.paper.record import EvaluationRecord
    from studies.paper.runs import Run

Report = Callable[[str, float | None], None]


@dataclass(frozen=True, kw_only=True)
class Compare:
    """Evaluate the policies of all methods and print the paper's Table II beside ours.

    Runs are folders <runs>/<method>/seed-<number>/ with a policy.onnx, or a checkpoint.pt, which is exported.
    Every speed that is done is kept in the cache: a killed command goes on where it was. A run whose
    evaluation.json already answers for its policy, these settings and these versions is not run again.

    Attributes:
        runs: folder of finished runs; each gets its evaluation.json.
        recorded: do not evaluate: make the tables from the evaluation.json of the runs.
        markdown: also put the tables between the marks of this page.
        train: first train what is missing (needs the training extra, a GPU advised).
        seeds: number of seeds a method to train.
        minutes: training time of each run.
        robot: a robot's name, or a parameter table of one's own (.toml).
        workers: processes; one a core when left out.
        cache: folder of finished speeds.
        out: also write the table and every record here, as JSON.
        json: print JSON only.
        search: trials and speeds.
    """

    runs: tyro.conf.Positional[Path]
    recorded: tyro.conf.FlagCreatePairsOff[bool] = False
    markdown: Path | None = None
    train: tyro.conf.FlagCreatePairsOff[bool] = False
    seeds: int = 3
    minutes: float = 20.0
    robot: str = "bp2"
    workers: int | None = None
    cache: Path = Path("runs/evaluation-cache")
    out: Path | None = None
    json: tyro.conf.FlagCreatePairsOff[bool] = False
    search: tyro.conf.FlagCreatePairsOff[SearchOptions] = SearchOptions()

    def run(self) -> int:
        """Evaluate, print, write.

        Raises:
            SprintlabError: a folder, policy or setting is refused, or the simulation failed.
        """
        self._check()
        records = self._records()
        from studies.paper.pages import update_results_page
        from studies.paper.runs import by_method

        grouped = by_method(records)
        numbers = _numbers(grouped)
        if self.out is not None:
            from sprintlab.core.files import atomic_write_json

            atomic_write_json(self.out, numbers)
        if self.markdown is not None:
            update_results_page(self.markdown, grouped)
        if self.json:
            print_json(numbers)
        else:
            _print_tables(grouped)
        return 0

    def _check(self) -> None:
        from sprintlab.core.files import check_writable, check_writable_file

        if self.out is not None:
            check_writable_file(self.out)
        if not self.recorded:
            check_writable(self.cache / "speed.json")
        if self.recorded and self.train:
            raise SprintlabError("--recorded evaluates nothing, so there is nothing to --train for")
        if self.markdown is not None:
            from studies.paper.pages import RESULT_SECTIONS, check_sections

            check_sections(self.markdown, RESULT_SECTIONS)

    def _records(self) -> list[EvaluationRecord]:
        from studies.paper.runs import committed_records, find_runs

        if self.train:
            train_missing(self.runs, self.seeds, self.minutes)
        runs = find_runs(self.runs)
        if self.recorded:
            return committed_records(runs)
        export_missing(runs)
        fresh = {(run.method, run.seed): run for run in runs if run.policy.is_file()}
        kept = committed_records(run for run in runs if (run.method, run.seed) not in fresh)
        return [*kept, *self._evaluate(_candidates(fresh.values()), fresh)]

    def _evaluate(
        self, candidates: Sequence[Candidate], runs: dict[tuple[str, int], Run]
    ) -> list[EvaluationRecord]:
        """Evaluate under a progress bar; a run's record goes into its folder as soon as it is there."""
        from studies.paper.measure import answers, evaluate_candidates
        from studies.paper.record import write_evaluation
        from studies.paper.runs import readable_records

        def keep(candidate: Candidate, record: EvaluationRecord) -> None:
            if run := runs.get((candidate.method, candidate.seed)):
                write_evaluation(run.evaluation, record)

        with progress_bar(quiet=self.json) as report:
            report("loading", None)
            plan = self._plan()
            known = {(record.method, record.seed): record for record in readable_records(runs.values())}
            done: dict[Candidate, EvaluationRecord] = {}
            for candidate in candidates:
                record = known.get((candidate.method, candidate.seed))
                if record is not None and answers(record, candidate, plan):
                    done[candidate] = record
            missing = [candidate for candidate in candidates if candidate not in done]
            step = _Progress(report, missing, self.search)
            return [*done.values(), *evaluate_candidates(missing, plan, done=keep, step=step)]

    def _plan(self) -> EvaluationPlan:
        from sprintlab.robots import load_robot
        from studies.paper.measure import EvaluationPlan

        return EvaluationPlan(
            robot=load_robot(self.robot),
            protocol=self.search.protocol(),
            cache=self.cache,
            workers=self.workers,
            command_line=shlex.join(["python", "-m", "studies.paper", *sys.argv[1:]]),
        )


class _Progress:
    """Turns finished steps of several policies into one share."""

    def __init__(self, report: Report, candidates: Sequence[Candidate], search: SearchOptions) -> None:
        self._report, self._count, self._search = report, len(candidates), search
        self._shares: dict[str, float] = {}

    def __call__(self, candidate: Candidate, what: str, top_speed: float) -> None:
        name = f"{candidate}: {what.split()[0]}"  # both ways run at the same time
        self._shares[name] = max(self._shares.get(name, 0.0), self._search.share(top_speed))
        self._report(f"{candidate}: {what}", min(1.0, sum(self._shares.values()) / (2 * self._count)))


def train_missing(folder: Path, seeds: int, minutes: float) -> None:
    """Train every method and seed that has neither policy nor checkpoint.

    Raises:
        SprintlabError: the training extra is not installed, a run's folder is a link, or training refuses.
    """
    from sprintlab.api.training import require_training
    from sprintlab.core.checks import check_range
    from sprintlab.training.settings import PpoSettings, TrainingSettings
    from studies.paper.paper import PAPER_TABLE
    from studies.paper.plan import PRECISION
    from studies.paper.runs import Run, check_own_folder

    check_range("seeds", seeds, 1, 1000)
    require_training()
    from sprintlab.training.runs.run import TrainOptions, train

    settings = TrainingSettings(ppo=PpoSettings(precision=PRECISION))

    for method in PAPER_TABLE:
        for seed in range(seeds):
            run = Run(method=method, seed=seed, folder=folder / method / f"seed-{seed}")
            check_own_folder(run.folder)
            if not (run.policy.exists() or run.checkpoint.exists()):
                stderr_console().print(f"training {method}, seed {seed}")
                options = {"method": method, "seed": seed, "minutes": minutes, "settings": settings}
                train(TrainOptions(output=run.folder, **options))


def export_missing(runs: Sequence[Run]) -> None:
    """Export the checkpoints of runs that have no policy yet; errors as ``sprintlab export`` has them."""
    missing = [run for run in runs if run.checkpoint.is_file() and not run.policy.exists()]
    if not missing:
        return
    from sprintlab.api.training import require_training

    require_training()
    from sprintlab.training.runs.export import export_checkpoint

    for run in missing:
        export_checkpoint(run.checkpoint, run.policy)


def _candidates(runs: Any) -> list[Candidate]:
    from studies.paper.measure import Candidate

    return [Candidate(method=run.method, seed=run.seed, policy=run.policy) for run in runs]


def _numbers(grouped: dict[str, list[EvaluationRecord]]) -> dict[str, Any]:
    from studies.paper.record import encode
    from studies.paper.table import table_numbers

    records = [encode(record) for group in grouped.values() for record in group]
    return {**table_numbers(grouped), "records": records}


def _print_tables(grouped: dict[str, list[EvaluationRecord]]) -> None:
    from studies.paper.pages import result_tables

    console = stdout_console()
    for table in result_tables(grouped):
        printed = plain_table(table.title, *table.columns, numbers=table.columns[1:])
        printed.columns[0].no_wrap = True
        for row in table.rows:
            printed.add_row(*row)
        console.print(printed)
        console.print(table.note, style="dim", soft_wrap=True)
        console.print()
