"""Checks of single fields: they raise before any work is lost and say what is allowed."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

from sprintlab.core.errors import InvalidValueError

_INFINITE = float("inf")


def every(condition: Any) -> bool:
    """True where a scalar or every element of an array satisfies the condition."""
    return bool(condition.all()) if hasattr(condition, "all") else bool(condition)


def check_finite(field: str, value: Any) -> None:
    """Refuse NaN, infinity and values that are not numbers. Raises ``InvalidValueError``."""
    try:  # compared, not abs(): a complex number has one, too
        finite = every((value > -_INFINITE) & (value < _INFINITE))
        if isinstance(value, int):
            float(value)  # Python's whole numbers go on beyond all floats
    except (TypeError, OverflowError):
        finite = False
    if isinstance(value, bool) or not finite:
        raise InvalidValueError(field, value, "must be a finite number")


def check_range(field: str, value: Any, low: float, high: float, unit: str = "") -> None:
    """Refuse values outside ``[low, high]``. Raises ``InvalidValueError``."""
    check_finite(field, value)
    if not every((value >= low) & (value <= high)):
        raise InvalidValueError(field, value, f"must lie in [{low:g}, {high:g}] {unit}".rstrip())


def check_interval(
    field: str, interval: Sequence[float], low: float, high: float = _INFINITE, unit: str = ""
) -> None:
    """Refuse a pair that is not ``low <= first <= second <= high``. Raises ``InvalidValueError``."""
    if len(interval) != 2:
        raise InvalidValueError(field, interval, "a pair (lowest, highest)")
    for value in interval:
        check_range(field, value, low, high, unit)
    if interval[0] > interval[1]:
        raise InvalidValueError(field, interval, "the first must not exceed the second")


def check_positive(field: str, value: Any, unit: str = "") -> None:
    """Refuse zero and negative values. Raises ``InvalidValueError``."""
    check_finite(field, value)
    if not every(value > 0):
        raise InvalidValueError(field, value, f"must be greater than 0 {unit}".rstrip())


def check_choice(field: str, value: object, choices: Collection[Any]) -> None:
    """Refuse values outside a closed list. Raises ``InvalidValueError``."""
    if value not in choices:
        raise InvalidValueError(field, value, "choose one of " + ", ".join(map(str, choices)))
