"""``python -m studies.paper plan``: which trainings the study consists of, and which are missing."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path

import tyro

from sprintlab.cli.output import print_json
from sprintlab.training.methods import ALL_METHODS
from studies.paper.paper import PAPER_TABLE
from studies.paper.record import record_path

RESULTS = Path(__file__).parent / "results"
PRESETS = ("sprintlab", "paper")
"""Our reward table, and the paper's to the letter."""
SEEDS, SEEDS_OF_OTHERS = 10, 5
NO_SATURATION, LITERAL_ACS = "no-saturation", "literal-acs"
OTHERS = ("rlvrl", "lp-acrl", "hound", "spot-battery", "flux-weakening")
"""Methods of other papers that differ from ``acs`` by a schedule or a switch."""


@dataclass(frozen=True, kw_only=True)
class Training:
    """One training of the study.

    Attributes:
        preset: reward table.
        method: of ``training.methods.ALL_METHODS``.
        seed: of its random numbers.
    """

    preset: str
    method: str
    seed: int

    def folder(self, runs: Path) -> Path:
        """Folder of its checkpoint and policy below a folder of runs."""
        return runs / self.preset / self.method / f"seed-{self.seed}"

    def words(self, runs: Path) -> list[str]:
        """The command that trains it."""
        words = ["sprintlab", "train", "bp2", "--method", self.method, "--seed", str(self.seed)]
        words += [] if self.preset == "sprintlab" else ["--preset", self.preset]
        return [*words, "--output", str(self.folder(runs))]


def study_trainings() -> list[Training]:
    """Every training, seed by seed, so that a plan that is cut short has compared all methods."""
    wanted = [(preset, method, SEEDS) for preset in PRESETS for method in PAPER_TABLE]
    wanted += [("sprintlab", NO_SATURATION, SEEDS), ("paper", LITERAL_ACS, SEEDS_OF_OTHERS)]
    wanted += [("sprintlab", method, SEEDS_OF_OTHERS) for method in OTHERS]
    return [
        Training(preset=preset, method=method, seed=seed)
        for seed in range(SEEDS)
        for preset, method, seeds in wanted
        if seed < seeds and method in ALL_METHODS
    ]


@dataclass(frozen=True, kw_only=True)
class Plan:
    """List the trainings of the study that are missing, one ``sprintlab train`` per line.

    Attributes:
        runs: folder of finished and future runs.
        results: folder of the committed records.
        json: print JSON only.
    """

    runs: tyro.conf.Positional[Path] = Path("runs/study")
    results: Path = RESULTS
    json: tyro.conf.FlagCreatePairsOff[bool] = False

    def run(self) -> int:
        """Print the missing commands."""
        trainings = study_trainings()
        lines = [shlex.join(each.words(self.runs)) for each in trainings if not self._done(each)]
        if self.json:
            print_json({"trainings": len(trainings), "missing": lines})
            return 0
        print("".join(f"{line}\n" for line in lines), end="")
        print(f"# {len(lines)} of {len(trainings)} trainings are missing")
        return 0

    def _done(self, training: Training) -> bool:
        recorded = record_path(self.results, training.preset, training.method, training.seed)
        return recorded.is_file() or (training.folder(self.runs) / "policy.onnx").is_file()
