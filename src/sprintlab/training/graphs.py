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
COMPILER_OPTIONS: dict[str, str | int | bool | Callable[..., object]] = {"force_pointwise_cat": True}
"""Every concatenation is computed where it is used: left to itself the compiler gives each of its parts a
kernel, which made 86 kernels of the step after physics where 40 do."""

VERSIONS = 256
"""Compiled functions that the compiler keeps under one name. Eight are its default, and every method under
``torch.no_grad`` counts as the same one: a second run in a process would be refused."""


def compiled(work: Callable[Arguments, Result], fused: bool) -> Callable[Arguments, Result]:
    """``work`` with its kernels fused; ``work`` itself where ``fused`` is off.

    What cannot be compiled in one piece is an error: in pieces it would run, slowly, and without a word.
    """
    if not fused:
        return work
    keep_compiled_code_private()
    torch._dynamo.config.recompile_limit = VERSIONS
    return torch.compile(work, dynamic=False, fullgraph=True, options=COMPILER_OPTIONS)


def captured(work: Callable[[], None], device: str) -> Callable[[], None]:
    """``work`` as a graph to be launched; ``work`` itself where ``device`` is no GPU.

    It is run ``WARM_UP`` times first and leaves its traces in the buffers: the caller restores them.
    """
    if not str(device).startswith("cuda"):
        return work
    stream = torch.cuda.Stream(device)
    stream.wait_stream(torch.cuda.current_stream(device))
    with torch.cuda.stream(stream):
        for _ in range(WARM_UP):
            work()
    torch.cuda.current_stream(device).wait_stream(stream)
    torch.cuda.synchronize(device)
    graph = torch.cuda.CUDAGraph()
    with suspended_garbage_collection(), torch.cuda.graph(graph):
        work()
    return graph.replay
