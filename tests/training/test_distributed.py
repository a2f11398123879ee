"""Two processes share gradients and statistics as one process with both batches would have them."""

from __future__ import annotations

import os
import socket
from pathlib import Path

import pytest
import torch
from torch import multiprocessing

from sprintlab.training.learner.distributed import Workers, join_workers

BATCHES = torch.arange(12.0).reshape(2, 6) ** 1.5


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def share(rank: int, port: int, folder: str) -> None:
    os.environ |= {
        "MASTER_ADDR": "127.0.0.1", "MASTER_PORT": str(port), "WORLD_SIZE": "2", "RANK": str(rank),
        "LOCAL_RANK": str(rank), "CUDA_VISIBLE_DEVICES": "",
    }  # fmt: skip
    workers = join_workers()
    mine = BATCHES[rank].clone()
    mean, variance = workers.moments(mine.mean(), mine.var(correction=0))
    gradients = [mine[:2].clone(), mine[2:].reshape(2, 2).clone()]
    for gradient in gradients:
        workers.average(gradient)
    weights = [torch.full((3,), float(rank))]
    workers.broadcast(weights)
    result = {"mean": mean, "variance": variance, "gradients": gradients, "weights": weights[0]}
    torch.save({**result, "leads": workers.leads}, Path(folder) / f"{rank}.pt")


def test_statistics_and_gradients_are_shared(tmp_path: Path) -> None:
    torch.set_num_threads(1)  # no pool that a fork would lose; to import PyTorch anew takes seconds
    multiprocessing.start_processes(share, args=(free_port(), str(tmp_path)), nprocs=2, start_method="fork")
    both = BATCHES.flatten()
    for rank in (0, 1):
        result = torch.load(tmp_path / f"{rank}.pt")
        torch.testing.assert_close(result["mean"], both.mean())
        torch.testing.assert_close(result["variance"], both.var(correction=0))
        torch.testing.assert_close(result["gradients"][0], BATCHES.mean(0)[:2])
        torch.testing.assert_close(result["gradients"][1], BATCHES.mean(0)[2:].reshape(2, 2))
        assert torch.equal(result["weights"], torch.zeros(3))
        assert result["leads"] == (rank == 0)


def test_one_process_is_left_as_it_is() -> None:
    alone, values = Workers(), BATCHES[0].clone()
    alone.average(values)
    assert torch.equal(values, BATCHES[0])
    normalized = alone.normalized(values)
    assert float(normalized.mean()) == pytest.approx(0.0, abs=1e-6)
    assert float(normalized.std()) == pytest.approx(1.0, abs=1e-6)
