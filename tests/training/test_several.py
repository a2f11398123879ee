"""Two processes under torchrun: identical networks, normalizers and curriculum, also in a resumed run.

Over gloo on the CPU; with two GPUs also over NCCL, whose operations are part of the update's graph.
"""

from __future__ import annotations

import os
import subprocess
import sys
from contextlib import nullcontext
from pathlib import Path

import pytest
import torch
from tests.training.small import small_settings

from sprintlab.core.errors import SprintlabError
from sprintlab.training.learner.distributed import Workers
from sprintlab.training.runs.checkpoint import read_checkpoint
from sprintlab.training.runs.run import TrainOptions, open_run, train
from sprintlab.training.runs.runner import Runner

PROGRAM = """
import sys
from dataclasses import replace
from pathlib import Path
import torch
torch.set_num_threads(1)
from sprintlab.training.runs import run
from tests.training.small import small_settings

folder, device, runners = Path(sys.argv[1]), sys.argv[2], []
options = run.TrainOptions(
    output=folder / "run", environments=8, iterations=2, device=device, tensorboard=False,
    settings=small_settings(), resume=True,
)
opened = run.open_run
run.open_run = lambda *a: runners.append(opened(*a)) or runners[-1]
for iterations in (2, 4):
    run.train(replace(options, iterations=iterations))
runner = runners[-1]
log = [{k: v for k, v in row.items() if "second" not in k} for row in runner.progress.log]
own = {"networks": runner.learner._networks(), "moments": runner.learner._moments(), "log": log}
own |= {"growth": vars(runner.growth), "robots": runner.environment.state()}
torch.save(own, folder / f"{runner.workers.rank}.pt")
"""


TORCHRUN = ("--standalone", "--local-addr", "127.0.0.1", "--nproc-per-node", "2")


def train_on_two(folder: Path, device: str) -> Path:
    """Run the program in two processes; returns the folder of what they ended with."""
    (folder / "program.py").write_text(PROGRAM)
    own = {"OMP_NUM_THREADS": "1", "PYTHONPATH": os.pathsep.join(sys.path)}
    own |= {"CUDA_VISIBLE_DEVICES": ""} if device == "cpu" else {}
    done = subprocess.run(
        [sys.executable, "-m", "torch.distributed.run", *TORCHRUN, folder / "program.py", folder, device],
        env=os.environ | own,
        capture_output=True,
        text=True,
        timeout=300.0,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    return folder


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return train_on_two(tmp_path_factory.mktemp("several"), "cpu")


def read(folder: Path, name: str) -> dict:
    return torch.load(folder / f"{name}.pt", map_location="cpu", weights_only=False)


def test_both_processes_end_with_the_same_networks_and_curriculum(folder: Path) -> None:
    assert_equal_ends(folder)


@pytest.mark.skipif(torch.cuda.device_count() < 2, reason="needs two GPUs")
def test_two_gpus_end_with_the_same_networks_and_curriculum(tmp_path: Path) -> None:
    assert_equal_ends(train_on_two(tmp_path, "auto"))


def assert_equal_ends(folder: Path) -> None:
    first, second = read(folder, "0"), read(folder, "1")
    for name, value in first["networks"].items():  # normalizers are among them
        assert torch.equal(value, second["networks"][name]), name
    assert all(torch.equal(a, b) for a, b in zip(first["moments"], second["moments"], strict=True))
    assert first["log"] == second["log"] and len(first["log"]) == 4
    assert first["growth"] == second["growth"]
    for name in ("grid_weights", "upper", "stage"):
        assert torch.equal(first["robots"][name], second["robots"][name]), name
    assert not torch.equal(first["robots"]["action"], second["robots"]["action"])


def test_one_process_takes_up_the_run_of_two_and_three_do_too(folder: Path) -> None:
    state = read_checkpoint(folder / "run" / "checkpoint.pt")
    assert state["progress"].environment_steps == 2 * 8 * 2 * 4
    options = TrainOptions(output=folder / "run", device="cpu", resume=True)
    for workers in (Workers(), Workers(count=1, rank=2)):
        assert open_run(options, workers).iterate()["iteration"] == 5


@pytest.mark.parametrize("ends", ["well", "badly"])
def test_graphs_are_let_go_before_processes_part(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ends: str
) -> None:
    """NCCL gives no connection up whose operations a graph still holds: the process would wait for ever."""
    runners: list[Runner] = []

    class Watched(Runner):
        def iterate(self) -> dict[str, float]:
            runners.append(self)
            assert self.learner.update is not None
            if ends == "badly":
                raise SprintlabError("no room")
            return super().iterate()

    monkeypatch.setattr("sprintlab.training.runs.run.Runner", Watched)
    cheap = {"environments": 8, "iterations": 1, "device": "cpu", "tensorboard": False}
    options = TrainOptions(output=tmp_path, settings=small_settings(), **cheap)
    with nullcontext() if ends == "well" else pytest.raises(SprintlabError, match="no room"):
        train(options)
    assert not {"act", "record", "update"} & set(vars(runners[0].learner))
