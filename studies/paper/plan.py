"""``python -m studies.paper plan``: which trainings the study consists of, and which are missing."""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import tyro

from sprintlab.cli.output import print_json
from sprintlab.core.errors import printable_lines
from sprintlab.core.reading import check_folder
from studies.paper.runs import CHECKPOINT_NAME, EVALUATION_NAME, POLICY_NAME

HERE = Path(__file__).parent
RESULTS = HERE / "results"
PAPER_PRESET = "paper"
PRECISION = "bfloat16"
"""Of the networks' products in every training of the study (``ppo.precision``): all must share it."""
NETWORK_FILE, STRIDES_FILE = "studies/paper/actuator_network.npz", "studies/paper/strides.npz"


@dataclass(frozen=True, kw_only=True)
class Training:
    """One training of the study.

    Attributes:
        method: of ``training.methods.ALL_METHODS``.
        seed: of its random numbers.
        preset: of rewards and practice.
    """

    method: str
    seed: int
    preset: str = "sprintlab"

    def folder(self, root: Path) -> Path:
        """Where its run lies below a folder of runs; another preset has a folder of its own."""
        place = root if self.preset == "sprintlab" else root / self.preset
        return place / self.method / f"seed-{self.seed}"

    def words(self, root: Path) -> list[str]:
        """The command that trains it."""
        from sprintlab.training.methods import ALL_METHODS

        method = ALL_METHODS[self.method]
        words = ["sprintlab", "train", self.method, "--seed", str(self.seed)]
        words += [] if self.preset == "sprintlab" else ["--preset", self.preset]
        words += ["--ppo.precision", PRECISION, "--output", str(self.folder(root))]
        words += ["--simulation.actuator-network", NETWORK_FILE] if method.network else []
        strides = ["prior:stride-prior", "--prior.file", STRIDES_FILE]
        return [*words, *strides] if method.prior else words

    def done(self, folders: Iterable[Path]) -> bool:
        """Whether one of the folders of runs has its evaluation, policy or checkpoint."""
        kept = (EVALUATION_NAME, POLICY_NAME, CHECKPOINT_NAME)
        return any((self.folder(root) / name).is_file() for root in folders for name in kept)


def study_trainings() -> list[Training]:
    """Every training: the six methods with five seeds, all others and the paper's preset with three.

    Seed by seed, so that a plan that is cut short has compared all methods.
    """
    from sprintlab.training.methods import COMPARATORS, LITERAL_ACS, METHODS, NO_SATURATION

    ours = [Training(method=method, seed=seed) for seed in range(5) for method in METHODS]
    others = [
        Training(method=method, seed=seed) for seed in range(3) for method in (NO_SATURATION, *COMPARATORS)
    ]
    literal = [
        Training(method=method, seed=seed, preset=PAPER_PRESET)
        for seed in range(3)
        for method in (*METHODS, LITERAL_ACS)
    ]
    return [*ours, *others, *literal]


@dataclass(frozen=True, kw_only=True)
class Plan:
    """List the missing trainings of the study, one ``sprintlab train`` a line.

    Attributes:
        runs: folder of finished and future runs.
        results: folder of the committed results.
        json: print JSON only.
    """

    runs: tyro.conf.Positional[Path] = Path("runs/study")
    results: Path = RESULTS
    json: tyro.conf.FlagCreatePairsOff[bool] = False

    def run(self) -> int:
        """Print.

        Raises:
            SprintlabError: there are no results, or the runs lie in something that is no folder.
        """
        check_folder(self.results)
        if os.path.lexists(self.runs):
            check_folder(self.runs)
        trainings = study_trainings()
        missing = [each for each in trainings if not each.done((self.runs, self.results))]
        lines = [shlex.join(each.words(self.runs)) for each in missing]
        if self.json:
            print_json({"trainings": len(trainings), "missing": lines})
            return 0
        print(printable_lines("".join(f"{line}\n" for line in lines)), end="")
        print(f"# {len(missing)} of {len(trainings)} trainings are missing")
        return 0
