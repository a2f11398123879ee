"""How long the parts of an iteration take, on the device's own clock."""

from __future__ import annotations

import itertools
import time

import torch

PARTS = ("acting", "physics", "environment", "update")
_MARKS = ("start", *PARTS[:-1], "recorded", "update")


class Stopwatch:
    """Notes the ends of the parts in the last policy step of a rollout, and of the update; never waits.

    A mark is an event in the GPU's queue, or a moment of the host's clock on a CPU. The parts are read after
    the iteration's numbers have been read back, when all of them are over.
    """

    def __init__(self, device: str) -> None:
        self._events: dict[str, torch.cuda.Event] = {}
        self._moments: dict[str, float] = {}
        if device.startswith("cuda"):
            self._events = {name: torch.cuda.Event(enable_timing=True) for name in _MARKS}

    def mark(self, name: str) -> None:
        """Note that a part has ended: ``start``, acting, physics, environment, ``recorded`` or update."""
        if self._events:
            self._events[name].record()
        else:
            self._moments[name] = time.perf_counter()

    def seconds(self, steps: int) -> dict[str, float]:
        """Time of each part in an iteration of ``steps`` policy steps [s]; recording counts as acting."""
        acting, physics, environment, recording, update = (
            self._between(first, last) for first, last in itertools.pairwise(_MARKS)
        )
        per_step = {"acting": acting + recording, "physics": physics, "environment": environment}
        return {**{name: steps * value for name, value in per_step.items()}, "update": update}

    def _between(self, first: str, last: str) -> float:
        if self._events:
            return 1e-3 * self._events[first].elapsed_time(self._events[last])
        return self._moments[last] - self._moments[first]
