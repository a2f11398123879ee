"""Two processes share gradients and statistics as one process with both batches would have them."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from tests.training.small import on_two

from sprintlab.training.learner.distributed import Workers, join_workers

BATCHES = torch.arange(12.0).reshape(2, 6) ** 1.5


def share(rank: int, folder: Path) -> None:
    workers = join_workers()
    mine = BATCHES[rank].clone()
    mean, variance = workers.moments(mine.mean(), mine.var(correction=0))
    gradients = [mine[:2].clone(), mine[2:].reshape(2, 2).clone()]
    for gradient in gradients:
        workers.average(gradient)
    weights = [torch.full((3,), float(rank))]
    workers.broadcast(weights)
    result = {"mean": mean, "variance": variance, "gradients": gradients, "weights": weights[0]}
    torch.save({**result, "leads": workers.leads}, folder / f"{rank}.pt")


def test_statistics_and_gradients_are_shared(tmp_path: Path) -> None:
    on_two(share, tmp_path)
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
