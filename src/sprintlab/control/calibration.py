"""A policy that runs slower or faster than it is told is told another speed; its estimate is corrected alike.

A network that is trained to follow a command while it wears its motors little settles a few percent beside
the command, and its estimate of the speed leans toward the speeds that it saw most. Both errors depend on
the speed above all, so one table for each removes most of them. The tables stand outside the network, which
keeps reading its own estimate: told its true speed, it would run slower.

They were measured on the nominal robot: a feed-forward, no loop.
"""

from __future__ import annotations

from bisect import bisect_right
from itertools import pairwise

import msgspec

from sprintlab.core.checks import check_range
from sprintlab.core.errors import InvalidValueError

Speeds = tuple[float, ...]

MOST_POINTS = 64
"""Most points of a table."""
_FASTEST = 100.0  # highest speed of any table [m/s]
_STANDING = 1.0  # below this an estimate tells whether the robot stands, and is left as it is [m/s]


class CalibrationContract(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Which forward command the network is given, and which forward speed its estimate stands for.

    Both are piecewise linear between their points and change nothing below the first one, whose two speeds
    are equal; so nothing changes backward either.

    Attributes:
        commanded: forward commands of the robot [m/s] ``(2 to 64,)``, strictly rising.
        given: forward command that the network is given for each of them [m/s], as many, strictly rising;
            beyond the last measured speed it stays constant.
        estimated: forward speeds as the network estimates them [m/s] ``(2 to 64,)``, strictly rising.
        true: forward speed for each of them [m/s], as many, strictly rising; beyond the last one the
            estimate's error stays.

    Raises:
        InvalidValueError: a table is too short or too long, its two rows differ in length or in their first
            speed, a row does not rise strictly, or a speed is out of range.
    """

    commanded: Speeds
    given: Speeds
    estimated: Speeds
    true: Speeds

    def __post_init__(self) -> None:
        _check_table(("commanded", self.commanded), ("given", self.given), 0.0)
        _check_table(("estimated", self.estimated), ("true", self.true), _STANDING)


def given_speed(contract: CalibrationContract, commanded: float) -> float:
    """The forward command [m/s] that the network is given for the one that is commanded [m/s].

    Finite for every finite command, and it never falls where the command rises.
    """
    return _interpolated(contract.commanded, contract.given, min(commanded, contract.commanded[-1]))


def true_speed(contract: CalibrationContract, estimated: float) -> float:
    """The forward speed [m/s] that an estimate of the network [m/s] stands for.

    Finite for every finite estimate, and it never falls where the estimate rises.
    """
    last = contract.estimated[-1]
    return _interpolated(contract.estimated, contract.true, min(estimated, last)) + max(estimated - last, 0.0)


def _interpolated(places: Speeds, values: Speeds, speed: float) -> float:
    """The value at ``speed``, no faster than the last place; ``speed`` itself below the first one."""
    if speed <= places[0]:
        return speed
    above = bisect_right(places, speed, 1, len(places) - 1)
    low, high = places[above - 1], places[above]
    rise = values[above] - values[above - 1]
    # Rounding may pass the point above by the last bit, and the table would fall there.
    return min(values[above - 1] + (speed - low) / (high - low) * rise, values[above])


def _check_table(first: tuple[str, Speeds], second: tuple[str, Speeds], slowest: float) -> None:
    """Refuse two rows that are no table. Raises ``InvalidValueError``."""
    for name, speeds in (first, second):
        _check_row(f"calibration.{name}", speeds, slowest)
    (other, places), (name, values) = first, second
    if len(places) != len(values):
        raise InvalidValueError(f"calibration.{name}", values, f"{len(places)} speeds, as many as {other}")
    if places[0] != values[0]:
        raise InvalidValueError(f"calibration.{name}", values, f"first {places[0]:g} m/s, as of {other}")


def _check_row(field: str, speeds: Speeds, slowest: float) -> None:
    if not 2 <= len(speeds) <= MOST_POINTS:
        raise InvalidValueError(field, speeds, f"2 to {MOST_POINTS} speeds")
    for speed in speeds:
        check_range(field, speed, slowest, _FASTEST, "m/s")
    if any(above <= below for below, above in pairwise(speeds)):
        raise InvalidValueError(field, speeds, "each speed must be greater than the one before")
