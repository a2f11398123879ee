"""Time that passes only in a sleep: the machine's load plays no part."""


class FakeClock:
    """Stands for the module ``time``; a sleep takes ``extra`` longer than it should [s]."""

    def __init__(self, extra: float = 0.0) -> None:
        self.now, self.extra = 5_000_000_000, extra

    def monotonic_ns(self) -> int:
        return self.now

    def monotonic(self) -> float:
        return 1e-9 * self.now

    def sleep(self, seconds: float) -> None:
        self.now += round(1e9 * (seconds + self.extra))
