"""How old the state behind a command is when the command acts: measured, without comparing clocks."""

from __future__ import annotations

_MEMORY = 1024  # commands: a second of them, ten times what a robot may leave unanswered
_REPORTING = 0.001  # [s] for which a command has acted when a state reports it


class LinkAge:
    """Measures the way from the robot to the controller and back.

    Every state names the last command that the robot accepted. What has passed since that command was sent is
    the way there, a millisecond in which it acted, and the way back: both ways together are how old a state
    is by the time that the answer to it acts. Lost messages count, since the robot goes on with older ones.
    """

    def __init__(self) -> None:
        self._sent: list[tuple[int, int]] = [(-1, 0)] * _MEMORY

    def sent(self, sequence: int, now: int) -> None:
        """Note when a command leaves: number, controller's clock [ns]."""
        self._sent[sequence % _MEMORY] = sequence, now

    def both_ways(self, answered: int, now: int) -> float:
        """Age [s] of the last state when a command that leaves ``now`` [ns] acts; 0 where that is not known.

        Args:
            answered: number of the command that the last state names.
            now: controller's clock [ns].
        """
        sequence, left = self._sent[answered % _MEMORY]
        return max((now - left) * 1e-9 - _REPORTING, 0.0) if sequence == answered else 0.0
