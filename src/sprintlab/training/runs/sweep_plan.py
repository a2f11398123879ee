"""What a sweep consists of: methods x seeds x settings, each run with a folder of its own.

Nothing here needs PyTorch: planning and watching a sweep start at once.
"""

from __future__ import annotations

import itertools
import json
import re
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from sprintlab.core.errors import InvalidValueError, SprintlabError
from sprintlab.core.files import atomic_write_json
from sprintlab.core.reading import read_json
from sprintlab.training.methods import method
from sprintlab.training.runs.options import TrainOptions
from sprintlab.training.settings import TrainingSettings
from sprintlab.training.settings_text import as_text, parse_value, split_assignment, with_changes

RECORD_NAME = "run.json"


@dataclass(frozen=True, kw_only=True)
class RunPlan:
    """One training of a sweep.

    Attributes:
        method: one of ``training.methods.ALL_METHODS``.
        seed: of every random generator.
        folder: ``<sweep>/<method>/seed-<seed>``, below a folder of the varied settings if there are any.
        overrides: dotted names of settings to their values, e.g. ``ppo.steps`` to 16.
        iterations: at which the run ends.
        minutes: after which the run ends, over all sessions.
        environments: robots side by side.
        device: ``cuda:0``, ``cpu`` or ``auto``.
        save_seconds: time between checkpoints: what a lost worker costs at most.
        preset: of rewards and practice, see ``methods.PRESETS``.

    Raises:
        InvalidValueError: an unknown method or setting, or a number out of range.
    """

    method: str
    seed: int
    folder: Path
    overrides: Mapping[str, Any]
    iterations: int
    minutes: float
    environments: int
    device: str
    save_seconds: float
    preset: str = "sprintlab"

    def __post_init__(self) -> None:
        if not re.fullmatch(r"auto|cpu|cuda(:\d+)?", self.device):  # whether it is there, the worker knows
            raise InvalidValueError("device", self.device, "must be auto, cpu, cuda or cuda:NUMBER")
        self.options()

    @property
    def name(self) -> str:
        """The run in words: its varied settings, method and seed."""
        variant = self.folder.parent.parent.name if self.overrides else ""
        return f"{variant} {self.method} {self.seed}" if "=" in variant else f"{self.method} {self.seed}"

    def settings(self) -> TrainingSettings:
        """The method's settings with the overrides in place."""
        return with_changes(method(self.method, preset=self.preset, seed=self.seed), self.overrides)

    def options(self) -> TrainOptions:
        """The run as ``sprintlab train`` takes it."""
        return TrainOptions(
            settings=self.settings(),
            output=self.folder,
            minutes=self.minutes,
            iterations=self.iterations,
            environments=self.environments,
            device=self.device,
            save_seconds=self.save_seconds,
        )

    def digest(self) -> str:
        """Hash of the settings that this run is trained with."""
        return self.options().full_settings().digest()

    def command_line(self) -> str:
        """The ``sprintlab train`` that trains the same, for the policy's contract."""
        words: list[Any] = ["sprintlab", "train", "bp2", "--method", self.method, "--seed", self.seed]
        words += ["--preset", self.preset] if self.preset != "sprintlab" else []
        words += ["--iterations", self.iterations, "--minutes", self.minutes]
        overrides = {"simulation.environments": self.environments, **self.overrides}
        words += [word for name, value in overrides.items() for word in ("--set", f"{name}={as_text(value)}")]
        return shlex.join(map(str, words))

    def asked(self) -> dict[str, Any]:
        """What the run's record says about what was wanted."""
        wanted = {name: value for name, value in asdict(self).items() if name not in ("folder", "device")}
        return {**wanted, "overrides": dict(self.overrides), "config_hash": self.digest()}

    # --- the record in the run's folder ------------------------------------------------------------------

    def record(self) -> dict[str, Any] | None:
        """What ``run.json`` says; ``None`` where the run has not been begun.

        Raises:
            SprintlabError: the file is damaged.
        """
        path = self.folder / RECORD_NAME
        if not path.is_file():
            return None
        found = read_json(path, what="record")
        if not isinstance(found, dict):
            raise SprintlabError(f"{path} is damaged: it is no record of a run")
        return found

    def finished(self) -> bool:
        """Whether the run has been trained as far as this plan wants, and exported."""
        record = self.record() or {}
        far_enough = all(record.get(name) == self.asked()[name] for name in ("iterations", "minutes"))
        return bool(record.get("finished")) and far_enough

    def begin(self) -> None:
        """Write down what is about to be trained here.

        Raises:
            SprintlabError: other settings have been trained here, or the disk refuses.
        """
        record = self.record() or {}
        if record.get("config_hash", self.digest()) != self.digest():
            raise SprintlabError(f"{self.folder} holds a run with other settings: choose another folder")
        if not record and (self.folder / "checkpoint.pt").exists():
            raise SprintlabError(f"{self.folder} holds a checkpoint of another run: choose another folder")
        if not self.finished():
            atomic_write_json(self.folder / RECORD_NAME, {**self.asked(), "finished": False})

    def last_row(self) -> dict[str, float]:
        """The newest row of the log; empty if it has none."""
        log = self.folder / "log.jsonl"
        lines = log.read_text().splitlines() if log.is_file() else []
        return json.loads(lines[-1]) if lines else {}

    def share(self) -> float:
        """How much of the run is done, 0 to 1."""
        row = self.last_row()
        if not row:
            return 0.0
        return min(1.0, max(row["iteration"] / self.iterations, row["seconds"] / (60.0 * self.minutes)))


def plan_sweep(
    folder: Path,
    methods: Sequence[str],
    seeds: Sequence[int],
    fixed: Mapping[str, Any],
    varied: Mapping[str, Sequence[Any]],
    **limits: Any,
) -> list[RunPlan]:
    """Every combination, method by method.

    Args:
        folder: of the sweep.
        methods: to train.
        seeds: of each.
        fixed: settings that differ from the defaults in every run.
        varied: settings and their values; each combination gets a folder, ``name=value,name=value``.
        limits: the remaining attributes of ``RunPlan``.
    """
    plans: list[RunPlan] = []
    for values in itertools.product(*varied.values()):
        variant = dict(zip(varied, values, strict=True))
        place = folder / ",".join(f"{name}={_word(value)}" for name, value in variant.items())
        plans += [
            RunPlan(
                method=method,
                seed=seed,
                folder=place / method / f"seed-{seed}",
                overrides={**fixed, **variant},
                **limits,
            )
            for method in methods
            for seed in seeds
        ]
    return plans


def _word(value: Any) -> str:
    return json.dumps(value).replace(" ", "").replace('"', "").replace("/", "_")


def parse_variations(variations: Sequence[str]) -> dict[str, list[Any]]:
    """``["ppo.steps=8,16"]`` as a mapping to lists; errors as in ``with_changes``."""
    return {
        name: [parse_value(each) for each in _pieces(text)]
        for name, text in map(split_assignment, variations)
    }


def _pieces(text: str) -> list[str]:
    """Cut at the commas that stand outside brackets."""
    pieces, depth = [""], 0
    for letter in text:
        depth += (letter in "[{") - (letter in "]}")
        if letter == "," and depth == 0:
            pieces.append("")
        else:
            pieces[-1] += letter
    return pieces
