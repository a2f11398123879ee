"""How long a condition has held without a break."""

from __future__ import annotations


class Persistence:
    """True once a condition has held for ``duration`` [s]; one sample without it starts anew."""

    def __init__(self, duration: float) -> None:
        self._duration = duration - 1e-9  # times are sums of milliseconds, exact to rounding
        self._since: float | None = None

    def update(self, condition: bool, time: float) -> bool:
        """Take the condition at ``time`` [s]; returns whether it has held long enough."""
        if not condition:
            self._since = None
            return False
        if self._since is None:
            self._since = time
        return time - self._since >= self._duration

    def reset(self) -> None:
        """Forget the past."""
        self._since = None
