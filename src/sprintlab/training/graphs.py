"""Work on fixed buffers as one CUDA graph of compiled kernels; on the CPU the same work is simply done."""

from __future__ import annotations

from collections.abc import Callable
from typing import ParamSpec, TypeVar

import torch

from sprintlab.core.extras import keep_compiled_code_private
from sprintlab.core.garbage import suspended_garbage_collection

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")

WARM_UP = 3
"""Runs before a capture: PyTorch's advice for its allocator, cuBLAS and optimizers."""

VERSIONS = 256
"""Compiled functions that the compiler keeps under one name. Eight are its default, and every method under
``torch.no_grad`` counts as the same one: a second run in a process would be refused."""


def compiled(
    work: Callable[Arguments, Result], fused: bool, pointwise_cat: bool = False
) -> Callable[Arguments, Result]:
    """``work`` with its kernels fused; ``work`` itself where ``fused`` is off.

    What cannot be compiled in one piece is an error: in pieces it would run, slowly, and without a word.
    With ``pointwise_cat`` every concatenation is computed where it is used. Left to itself the compiler
    writes each part from where it is computed: right for two halves of a large tensor, but it made 86
    kernels of the environment's step where 40 do.
    """
    if not fused:
        return work
    keep_compiled_code_private()
    torch._dynamo.config.recompile_limit = VERSIONS
    return torch.compile(work, dynamic=False, fullgraph=True, options={"force_pointwise_cat": pointwise_cat})


def captured(work: Callable[[], None], device: str) -> Callable[[], None]:
    """``work`` as a graph to be launched; ``work`` itself where ``device`` is no GPU.

    It is run ``WARM_UP`` times first and leaves its traces in the buffers: the caller restores them.
    """
    if not str(device).startswith("cuda"):
        return work
    with torch.cuda.device(device), suspended_garbage_collection():  # a graph is captured on the current GPU
        stream = torch.cuda.Stream()
        stream.wait_stream(torch.cuda.current_stream())
        with torch.cuda.stream(stream):
            for _ in range(WARM_UP):
                work()
        torch.cuda.current_stream().wait_stream(stream)
        torch.cuda.synchronize()
        graph = torch.cuda.CUDAGraph()
        with torch.cuda.graph(graph):
            work()
    return graph.replay
