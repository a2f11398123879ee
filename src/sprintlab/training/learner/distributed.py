"""Several processes, one GPU each: gradients and statistics averaged over all of them (torchrun)."""

from __future__ import annotations

import atexit
import os
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import distributed


@dataclass(frozen=True, kw_only=True)
class Workers:
    """The processes of one training run; alone by default."""

    count: int = 1
    rank: int = 0  # rank of this process
    local_rank: int = 0  # rank of this process on its machine: which GPU it takes

    @property
    def several(self) -> bool:
        """Whether there is anybody to share with."""
        return self.count > 1

    @property
    def leads(self) -> bool:
        """Whether this process prints and saves."""
        return self.rank == 0

    def average(self, tensor: torch.Tensor) -> None:
        """Replace a tensor by its mean over the processes, in place."""
        if self.several:
            distributed.all_reduce(tensor)
            tensor.div_(self.count)

    def broadcast(self, tensors: Sequence[torch.Tensor]) -> None:
        """Give every process the values of the first."""
        if self.several:
            for tensor in tensors:
                distributed.broadcast(tensor.data, src=0)

    def any_of(self, flags: Sequence[bool]) -> list[bool]:
        """Each flag, raised if any process raises it: all of them stop and save at the same iteration."""
        if not self.several:
            return list(flags)
        on_gpu = distributed.get_backend() == "nccl"
        values = torch.tensor(flags, dtype=torch.int32, device=f"cuda:{self.local_rank}" if on_gpu else "cpu")
        distributed.all_reduce(values, distributed.ReduceOp.MAX)
        return [bool(value) for value in values.tolist()]

    def moments(self, mean: torch.Tensor, variance: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Mean and variance over all processes' samples, from each one's own."""
        if not self.several:
            return mean, variance
        pair = torch.stack((mean, variance + mean.square()))
        self.average(pair)
        return pair[0], pair[1] - pair[0].square()

    def normalized(self, values: torch.Tensor) -> torch.Tensor:
        """Zero mean, unit deviation over all processes' values."""
        mean, variance = self.moments(values.mean(), values.var())
        return (values - mean) / (variance.sqrt() + 1e-8)


def join_workers() -> Workers:
    """The processes that torchrun started, connected; alone if it started none."""
    count = int(os.environ.get("WORLD_SIZE", "1"))
    if count == 1:
        return Workers()
    local_rank = int(os.environ.get("LOCAL_RANK", "0"))
    if torch.cuda.is_available():
        torch.cuda.set_device(local_rank)
    if not distributed.is_initialized():
        distributed.init_process_group("nccl" if torch.cuda.is_available() else "gloo")
        atexit.register(distributed.destroy_process_group)
    return Workers(count=count, rank=distributed.get_rank(), local_rank=local_rank)
