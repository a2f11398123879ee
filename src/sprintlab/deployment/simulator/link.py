"""What a real link does to messages: it delays them, unevenly, and loses some."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from sprintlab.core.checks import check_range

Item = TypeVar("Item")


@dataclass(frozen=True, kw_only=True)
class LinkOptions:
    """One direction of a link.

    Attributes:
        delay: every message takes at least this long [s], 0 to 1.
        jitter: and up to this much longer, drawn evenly for each message [s], 0 to 1.
        loss: share of messages that never arrive, 0 to 1.

    Raises:
        InvalidValueError: a field is outside its range.
    """

    delay: float = 0.0
    jitter: float = 0.0
    loss: float = 0.0

    def __post_init__(self) -> None:
        check_range("link.delay", self.delay, 0.0, 1.0, "s")
        check_range("link.jitter", self.jitter, 0.0, 1.0, "s")
        check_range("link.loss", self.loss, 0.0, 1.0)


class Link(Generic[Item]):
    """Messages under way in one direction. They never overtake each other, as in TCP or a serial line.

    Args:
        options: delay, jitter, loss.
        seed: decides which messages are late or lost.
    """

    def __init__(self, options: LinkOptions, seed: int) -> None:
        self._options = options
        self._random = np.random.default_rng(seed)
        self._under_way: deque[tuple[float, Item]] = deque()
        self._latest = 0.0

    def push(self, time: float, item: Item) -> None:
        """Hand a message to the link at ``time`` [s]."""
        lost, late = self._random.random(2)
        if lost < self._options.loss:
            return
        arrival = time + self._options.delay + late * self._options.jitter
        self._latest = max(self._latest, arrival)
        self._under_way.append((self._latest, item))

    def pop(self, time: float) -> list[Item]:
        """Everything that has arrived by ``time`` [s], in order."""
        arrived = []
        # Times are sums of steps: half a microsecond of rounding must not cost a whole step.
        while self._under_way and self._under_way[0][0] <= time + 5e-7:
            arrived.append(self._under_way.popleft()[1])
        return arrived

    def clear(self) -> int:
        """Lose everything that is under way; returns how many messages that were."""
        lost = len(self._under_way)
        self._under_way.clear()
        return lost
