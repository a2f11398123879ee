"""``python -m studies.paper plan`` and ``train``: which trainings are missing, and how to train them."""

from __future__ import annotations

import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import tyro

from sprintlab.cli.output import print_json, progress_bar
from sprintlab.core.checks import check_positive, check_range
from sprintlab.training.methods import ALL_METHODS
from sprintlab.training.runs.sweep import SweptRun, plan_sweep, train_all, training_devices
from studies.paper.paper import PAPER_TABLE, REFERENCE_METHOD
from studies.paper.record import PRESETS, RESULTS, Runs, read_runs, record_path
from studies.paper.verdicts import CLAIMS, MOST_SEEDS, OPEN, SEEDS, judge

SEEDS_OF_OTHERS = 5
NO_SATURATION, LITERAL_ACS = "no-saturation", "literal-acs"
OTHERS = ("rlvrl", "lp-acrl", "hound", "spot-battery", "flux-weakening")
"""Methods of other papers that differ from ``acs`` by a schedule or a switch."""
ITERATIONS, ENVIRONMENTS = 2400, 4096
"""Length and size of every training, the same however many share a GPU."""
SPARE_SECONDS = 30.0
"""Before the end of the budget, at which trainings are told to save and end [s]."""


@dataclass(frozen=True, kw_only=True)
class Training:
    """One training of the study.

    Attributes:
        preset: reward table.
        method: method of ``training.methods.ALL_METHODS``.
        seed: seed of its random numbers.
    """

    preset: str
    method: str
    seed: int

    def swept(self, runs: Path, iterations: int, environments: int) -> SweptRun:
        """The training as a run of a sweep, below a folder of runs."""
        (run,) = plan_sweep(
            runs / self.preset,
            methods=[self.method],
            preset=self.preset,
            seeds=[self.seed],
            iterations=iterations,
            environments=environments,
        )
        return replace(run, name=f"{self.preset} {run.name}", words=(*run.words, "--plain"))


def study_trainings(runs: Runs) -> list[Training]:
    """Every training: the methods of the claims with our reward, then with the paper's, then the others.

    Each part goes seed by seed, so that a plan that is cut short has compared all its methods. A pair of
    methods that its seeds leave open gets more of them, up to twenty.
    """
    wanted = {(PRESETS[0], method): SEEDS for method in (*PAPER_TABLE, NO_SATURATION)}
    wanted |= {(PRESETS[1], method): SEEDS for method in PAPER_TABLE}
    others = {(PRESETS[1], LITERAL_ACS), *((PRESETS[0], method) for method in OTHERS)}
    wanted |= dict.fromkeys(sorted(others), SEEDS_OF_OTHERS)
    for preset in PRESETS:
        for claim in CLAIMS:
            pair = [(preset, REFERENCE_METHOD), (preset, claim.other)]
            if (
                all(len(runs.get(key, ())) >= SEEDS for key in pair)
                and judge(runs, claim, preset).said == OPEN
            ):
                wanted |= dict.fromkeys(pair, MOST_SEEDS)
    planned = [
        Training(preset=preset, method=method, seed=seed)
        for seed in range(MOST_SEEDS)
        for (preset, method), seeds in wanted.items()
        if seed < seeds and method in ALL_METHODS
    ]
    return sorted(
        planned, key=lambda each: ((each.preset, each.method) in others, PRESETS.index(each.preset))
    )


def missing_trainings(results: Path) -> tuple[list[Training], int]:
    """The trainings without a record, and how many the study consists of."""
    planned = study_trainings(read_runs(results))
    lacking = [
        each for each in planned if not record_path(results, each.preset, each.method, each.seed).is_file()
    ]
    return lacking, len(planned)


@dataclass(frozen=True, kw_only=True)
class Plan:
    """List the trainings of the study that are missing, one ``sprintlab train`` per line.

    Attributes:
        runs: folder of finished and future runs.
        results: folder of the committed records.
        iterations: iterations of each training.
        environments: robots side by side in each.
        json: print JSON only.
    """

    runs: tyro.conf.Positional[Path] = Path("runs/study")
    results: Path = RESULTS
    iterations: int = ITERATIONS
    environments: int = ENVIRONMENTS
    json: tyro.conf.FlagCreatePairsOff[bool] = False

    def run(self) -> int:
        """Print the missing commands."""
        lacking, planned = missing_trainings(self.results)
        runs = [each.swept(self.runs, self.iterations, self.environments) for each in lacking]
        lines = [run.command for run in runs if not run.finished]
        if self.json:
            print_json({"trainings": planned, "missing": lines})
            return 0
        print("".join(f"{line}\n" for line in lines), end="")
        print(f"# {len(lines)} of {planned} trainings are missing")
        return 0


class TimeOver(Exception):
    """The budget of minutes is used up."""


@dataclass(frozen=True, kw_only=True)
class Train:
    """Work down the plan for some minutes; given again, it goes on where it stopped.

    Attributes:
        runs: folder of the runs.
        results: folder of the committed records: what has one is not trained again.
        device: auto: all GPUs of this machine, or its CPU; or one of them: cuda:0, cpu.
        minutes: after which everything has ended; a training that is cut short saves and goes on next time.
        parallel: trainings that share a GPU, or the CPU.
        iterations: iterations of each training.
        environments: robots side by side in each.
        retries: how often a training that failed or was killed is started again.
    """

    runs: tyro.conf.Positional[Path] = Path("runs/study")
    results: Path = RESULTS
    device: str = "auto"
    minutes: float = 60.0
    parallel: int = 3
    iterations: int = ITERATIONS
    environments: int = ENVIRONMENTS
    retries: int = 1

    def run(self) -> int:
        """Train until everything is done or the time is over.

        Raises:
            SprintlabError: trainings failed again and again; the others are done.
        """
        check_range("parallel", self.parallel, 1, 64)
        check_positive("minutes", self.minutes, "min")
        until = time.monotonic() + max(60.0 * self.minutes - SPARE_SECONDS, 0.5 * 60.0 * self.minutes)
        lacking = missing_trainings(self.results)[0]
        runs = [each.swept(self.runs, self.iterations, self.environments) for each in lacking]
        runs.sort(key=lambda run: not (run.folder / "checkpoint.pt").is_file())  # begun ones first

        def watch(states: Mapping[str, str]) -> None:
            done = sum(state == "finished" for state in states.values())
            report(f"{done} of {len(states)} trainings finished", done / max(len(states), 1))
            if time.monotonic() >= until:
                raise TimeOver

        with progress_bar() as report, suppress(TimeOver):  # the trainings have then saved and ended
            train_all(runs, self.parallel * training_devices(self.device), self.retries, watch)
        finished = sum(run.finished for run in runs)
        print(f"{finished} of {len(runs)} trainings that have no record are finished")
        return 0
