"""Killed, interrupted, out of disk, out of numbers: what a training run keeps.

It runs in processes forked from this one after the imports, which take seconds.
"""

from __future__ import annotations

import errno
import json
import os
import random
import shutil
import signal
import sys
import time
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

if not hasattr(os, "fork"):
    pytest.skip("needs os.fork", allow_module_level=True)

import torch
from tests.training.small import small_settings

from sprintlab.cli.main import main, parse
from sprintlab.core import files
from sprintlab.training.runs.checkpoint import read_checkpoint
from sprintlab.training.runs.run import TrainOptions, train
from sprintlab.training.runs.runner import Runner

SETTINGS = small_settings(16)
FLAGS = (
    "train", "bp2", "--set", "simulation.environments=16", "--device", "cpu", "--save-seconds", "0",
    "--set", "ppo.steps=2", "--set", "ppo.epochs=1", "--set", "ppo.mini_batches=2",
    "--set", "ppo.hidden=[16]", "--plain",
)  # fmt: skip
COMPLETE = {"checkpoint.pt", "log.jsonl", "run.toml", "policy.onnx"}


@pytest.fixture(scope="module", autouse=True)
def warm() -> None:
    """Load every kernel before the first fork, and keep to one thread: pools do not survive a fork.

    The first reading of the options takes five times as long as every later one.
    """
    torch.set_num_threads(1)
    parse(FLAGS)
    Runner(SETTINGS, "cpu", "warm").environment.advance()
    import_module("torch.onnx.ops")  # what an export imports


def start(work: Callable[[], object], errors: str | Path = os.devnull) -> int:
    """Work in a process of its own, its stderr in a file; returns its id."""
    child = os.fork()
    if child:
        return child
    status = 1
    try:
        sys.stderr = open(errors, "w", buffering=1)  # noqa: SIM115
        status = int(work() or 0)
    except SystemExit as stop:
        status = int(stop.code or 0)
    finally:
        os._exit(status)


def finish(child: int) -> int:
    """Exit status of a process; minus the signal that killed it."""
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def iterations(folder: Path) -> list[int]:
    """The iterations that a log has."""
    return [json.loads(line)["iteration"] for line in (folder / "log.jsonl").read_text().splitlines()]


def options(folder: Path, **changes) -> TrainOptions:
    given = {"environments": 16, "device": "cpu", "tensorboard": False, "settings": SETTINGS, "resume": True}
    return TrainOptions(output=folder, **(given | changes))


def test_a_run_that_is_killed_again_and_again_comes_to_its_end(tmp_path: Path) -> None:
    generator, reached = random.Random(0), [0]
    checkpoint = tmp_path / "checkpoint.pt"
    while reached[-1] < 6:
        asked = options(tmp_path, iterations=9, save_seconds=0.0)
        child = start(lambda asked=asked: train(asked) and None)
        before = checkpoint.stat().st_mtime_ns if checkpoint.exists() else 0
        while not checkpoint.exists() or checkpoint.stat().st_mtime_ns == before:
            time.sleep(0.001)
        time.sleep(generator.uniform(0.0, 0.02))  # somewhere in what it does next
        os.kill(child, signal.SIGKILL)
        finish(child)
        reached.append(read_checkpoint(checkpoint)["progress"].iteration)
    assert reached == sorted(reached) and len(set(reached)) >= 3
    train(options(tmp_path))  # the length is that of the run
    assert iterations(tmp_path) == list(range(1, 10))
    assert {path.name for path in tmp_path.iterdir()} == COMPLETE


@pytest.mark.parametrize(
    ("number", "status"), [(signal.SIGTERM, 143), (signal.SIGINT, 130), (signal.SIGHUP, 129)]
)
def test_a_request_to_stop_saves_first(tmp_path: Path, number: int, status: int) -> None:
    said = tmp_path / "stderr"
    command = [*FLAGS, "--save-seconds", "1000", "--output", str(tmp_path)]

    def begin() -> int:
        signal.signal(signal.SIGHUP, signal.SIG_DFL)  # the tests may run where a hangup is ignored
        return main(command)

    child = start(begin, errors=said)
    while not (said.exists() and "iteration 1," in said.read_text()):
        time.sleep(0.02)
    assert not (tmp_path / "checkpoint.pt").exists()  # nothing is saved by itself
    os.kill(child, number)
    assert finish(child) == status
    assert read_checkpoint(tmp_path / "checkpoint.pt")["progress"].iteration == len(iterations(tmp_path))
    assert "saved; go on with --resume" in said.read_text()


@pytest.fixture(scope="module")
def begun(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of one iteration, to be copied."""
    folder = tmp_path_factory.mktemp("begun") / "run"
    train(options(folder, iterations=1))
    return folder


@pytest.mark.parametrize("fitting", [0, 1, 2])
def test_a_full_disk_stops_with_the_last_checkpoint_intact(
    tmp_path: Path, begun: Path, monkeypatch, capsys, fitting: int
) -> None:
    shutil.copytree(begun, tmp_path, dirs_exist_ok=True)
    before = (tmp_path / "checkpoint.pt").read_bytes()
    written = []

    def full(_handle: int) -> None:
        written.append(1)
        if len(written) > fitting:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(files.os, "fsync", full)
        assert main([*FLAGS, "--iterations", "3", "--output", str(tmp_path), "--resume"]) == 2
    message = capsys.readouterr().err.splitlines()[-1]
    assert message.startswith("sprintlab: training stopped at iteration")
    assert "No space left on device" in message
    assert {path.name for path in tmp_path.iterdir()} == COMPLETE
    if fitting < 2:  # the third write is the log, after a checkpoint that fitted
        assert (tmp_path / "checkpoint.pt").read_bytes() == before
    train(options(tmp_path, iterations=3))
    assert iterations(tmp_path) == [1, 2, 3]


def test_broken_physics_and_a_diverged_update_are_undone_and_reported(
    tmp_path: Path, monkeypatch, capfd
) -> None:
    kept = {}

    class Struck(Runner):
        """Two robots become NaN before the second iteration; the third learns from a reward of NaN."""

        def iterate(self) -> dict[str, float]:
            if self.progress.iteration == 1:
                self.environment.engine.qvel[3:5] = float("nan")
            if self.progress.iteration == 2:
                kept.update({name: value.clone() for name, value in self.learner.actor.state_dict().items()})
                advance = self.environment.advance

                def poisoned(**given: Any) -> None:
                    advance(**given)
                    self.environment.reward[0] = float("nan")

                self.environment.advance = poisoned
            return super().iterate()

    monkeypatch.setattr("sprintlab.training.runs.run.Runner", Struck)
    train(options(tmp_path, iterations=3))
    state = read_checkpoint(tmp_path / "checkpoint.pt")
    log = state["progress"].log
    assert [row["broken"] for row in log] == [0, 2, 0]
    assert all(value == value for row in log[:2] for value in row.values())
    said = " ".join(capfd.readouterr().err.split())
    assert "2 robots with broken physics" in said and "update 3 diverged and was taken back" in said
    assert float(state["learner"]["rolled_back"]) == 1.0
    for name, value in kept.items():
        assert torch.equal(value, state["learner"]["actor"][name]), name
