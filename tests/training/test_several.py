"""Two processes: identical networks, normalizers and curriculum, also in a resumed run.

Over gloo on the CPU; with two GPUs over NCCL, whose operations are part of the update's graph.
"""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path

import pytest
import torch
from tests.training.small import networks, on_two, small_settings, tensors

from sprintlab.core.errors import SprintlabError
from sprintlab.training.learner.distributed import Workers
from sprintlab.training.runs import run
from sprintlab.training.runs.checkpoint import read_checkpoint
from sprintlab.training.runs.run import TrainOptions, open_run, train
from sprintlab.training.runs.runner import Runner


def train_as_one_of_two(rank: int, folder: Path) -> None:
    """Train, resume, and keep what the process ends with."""
    runners, opened = [], run.open_run
    run.open_run = lambda *given: runners.append(opened(*given)) or runners[-1]
    for iterations in (2, 4):
        options = {"environments": 8, "iterations": iterations, "tensorboard": False, "resume": True}
        train(TrainOptions(output=folder / "run", settings=small_settings(), **options))
    runner = runners[-1]
    log = [{k: v for k, v in row.items() if "second" not in k} for row in runner.progress.log]
    own = {"networks": networks(runner.learner), "moments": runner.learner._moments(), "log": log}
    own |= {"growth": vars(runner.growth), "robots": tensors(runner.environment)}
    torch.save(own, folder / f"{rank}.pt")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("several")
    on_two(train_as_one_of_two, made, gpus=torch.cuda.device_count() > 1)
    return made


def read(folder: Path, name: str) -> dict:
    return torch.load(folder / f"{name}.pt", map_location="cpu", weights_only=False)


def test_both_processes_end_with_the_same_networks_and_curriculum(folder: Path) -> None:
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
