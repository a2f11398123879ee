"""Many trainings: methods x seeds x settings, each a ``sprintlab train`` with a folder of its own.

A run with a policy is finished, and one with a checkpoint goes on from it. So a sweep that was stopped goes
on when it is started again, and a cluster's scheduler can train the same commands.
"""

from __future__ import annotations

import itertools
import json
import re
import shlex
import subprocess
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sprintlab.core.errors import SprintlabError
from sprintlab.core.interpreters import new_interpreter
from sprintlab.training.methods import method
from sprintlab.training.runs.options import POLICY_NAME, RUN_FILE, TrainOptions
from sprintlab.training.settings_text import split_assignment, with_changes

_VALUE = re.compile(r"(?:\[.*?\]|\{.*?\}|[^,])+")
"""A value of a variation, up to a comma outside of brackets."""
OUTPUT = "output.txt"
"""What a run of a sweep prints, in its folder."""
STARTING = 2
"""Runs that start up on one GPU at a time: twenty that all compile the same kernels at once need five
minutes, while later ones find them in the cache and those that train already keep the GPU busy."""


@dataclass(frozen=True, kw_only=True)
class SweptRun:
    """One training of a sweep."""

    name: str  # the run in words: its varied settings, method and seed
    folder: Path  # <sweep>/<method>/seed-<seed>, below a folder of the varied settings if there are any
    words: tuple[str, ...]  # words of sprintlab train that train it, or go on with it
    digest: str  # hash of its settings

    @property
    def command(self) -> str:
        """What to type to train it, or to go on with it."""
        return shlex.join(("sprintlab", *self.words))

    @property
    def finished(self) -> bool:
        """Whether the run has been trained and exported."""
        return (self.folder / POLICY_NAME).is_file()

    def check(self) -> None:
        """Refuse a folder in which other settings are being trained. Raises ``SprintlabError``."""
        path = self.folder / RUN_FILE
        if path.is_file() and self.digest not in path.read_text(encoding="utf-8"):
            raise SprintlabError(f"{self.folder} holds a run with other settings: choose another folder")

    def last_row(self) -> dict[str, float]:
        """The newest row of the log; empty if it has none."""
        log = self.folder / "log.jsonl"
        lines = log.read_text(encoding="utf-8").splitlines() if log.is_file() else []
        return json.loads(lines[-1]) if lines else {}


def plan_sweep(
    folder: Path,
    *,
    robot: str = "bp2",
    methods: Sequence[str],
    preset: str = "sprintlab",
    seeds: Sequence[int],
    fixed: Sequence[str] = (),
    varied: Mapping[str, Sequence[str]] | None = None,
    **limits: Any,
) -> list[SweptRun]:
    """Every combination, method by method.

    Args:
        fixed: Settings that differ from the defaults in every run, ``"ppo.steps=16"``.
        varied: Settings and their values; each combination gets a folder, ``name=value,name=value``.
        limits: Values of ``minutes``, ``iterations``, ``environments`` and ``device`` of ``TrainOptions``.
    """
    runs: list[SweptRun] = []
    limits = {name: value for name, value in limits.items() if value is not None}
    for values in itertools.product(*(varied or {}).values()):
        variant = dict(zip(varied or {}, values, strict=True))
        varying = [f"{name}={value}" for name, value in variant.items()]
        label, changes = re.sub(r"[\s\"']", "", ",".join(varying)).replace("/", "_"), [*fixed, *varying]
        for name, seed in itertools.product(methods, seeds):
            settings = with_changes(method(name, robot=robot, preset=preset, seed=seed), changes)
            place = folder / label / name / f"seed-{seed}"
            options = TrainOptions(settings=settings, output=place, **limits)
            words: list[Any] = ["train", robot, "--method", name, "--seed", seed]
            words += ["--preset", preset] if preset != "sprintlab" else []
            words += [word for change in changes for word in ("--set", change)]
            words += [word for limit, value in limits.items() for word in (f"--{limit}", value)]
            words += ["--output", place, "--resume"]
            run = SweptRun(
                name=f"{label} {name} {seed}".strip(),
                folder=place,
                words=tuple(map(str, words)),
                digest=options.full_settings().digest(),
            )
            runs.append(run)
    return runs


def parse_variations(variations: Sequence[str]) -> dict[str, list[str]]:
    """``["ppo.steps=8,16"]`` as a mapping to texts."""
    return {name: _VALUE.findall(text) for name, text in map(split_assignment, variations)}


def training_devices(device: str) -> list[str]:
    """All GPUs of this machine, or its CPU, for ``auto``; else the one that is named."""
    import torch

    if device != "auto":
        return [device]
    return [f"cuda:{number}" for number in range(torch.cuda.device_count())] or ["cpu"]


def train_all(
    runs: Sequence[SweptRun],
    devices: Sequence[str],
    retries: int,
    watch: Callable[[Mapping[str, str]], None],
    pause: float = 1.0,
) -> None:
    """Train what is not finished, one process per device; ended early, they save and end as well.

    Args:
        devices: Devices to train on; one that is named twice trains two runs at a time.
        watch: Called now and then with the state of every run by its name: waiting, running, finished or
            failed.

    Raises:
        SprintlabError: a folder holds another run, or runs failed.
    """
    for run in runs:
        run.check()
    states = {run.name: "finished" if run.finished else "waiting" for run in runs}
    waiting, free = deque(run for run in runs if not run.finished), list(devices)
    active: dict[subprocess.Popen[bytes], tuple[SweptRun, str]] = {}
    starts = Counter[str]()
    try:
        while waiting or active:
            for device in list(free):
                if not waiting or not _has_room(device, active.values()):
                    continue
                run = waiting.popleft()
                free.remove(device)
                active[_started(run, device)] = run, device
                states[run.name], starts[run.name] = "running", starts[run.name] + 1
            for process in [process for process in active if process.poll() is not None]:
                run, device = active.pop(process)
                free.append(device)
                again = not run.finished and starts[run.name] <= retries
                states[run.name] = "finished" if run.finished else "waiting" if again else "failed"
                waiting.extend([run] if again else [])
            watch(states)
            time.sleep(pause if active else 0.0)
    finally:
        for process in active:
            process.terminate()
        for process in active:
            process.wait()
    failed = [f"{run.name}: {_last_line(run)}" for run in runs if states[run.name] == "failed"]
    if failed:
        raise SprintlabError(f"{len(failed)} of {len(runs)} runs failed: {'; '.join(failed)}")


def _has_room(device: str, active: Iterable[tuple[SweptRun, str]]) -> bool:
    """Whether another run may start up on a device."""
    starting = sum(each == device and not (run.folder / RUN_FILE).is_file() for run, each in active)
    return starting < STARTING or not device.startswith("cuda")


def _started(run: SweptRun, device: str) -> subprocess.Popen[bytes]:
    run.folder.mkdir(parents=True, exist_ok=True)
    with (run.folder / OUTPUT).open("ab") as output:
        words = run.words if "--device" in run.words else (*run.words, "--device", device)
        command = [*new_interpreter(), "-m", "sprintlab", *words]
        return subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=output, stderr=subprocess.STDOUT)


def _last_line(run: SweptRun) -> str:
    """The last thing that a run has said, such as its error."""
    lines = (run.folder / OUTPUT).read_text(encoding="utf-8", errors="replace").split("\n")
    return next((line.strip() for line in reversed(lines) if line.strip()), "it ended without a word")
