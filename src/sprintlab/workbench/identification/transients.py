"""Raw logs: means over short windows in which current and speed rest, instead of rows measured in the swing.

The model is one of steady points. A drive's log at 100 Hz holds them between its steps, and much else:
currents and torques that were sampled at different instants of a jump, and torque that turned the rotor
instead of the sensor. So the log is cut into windows; one counts where current and speed change little from
its first half to its second. The slope of the speed is kept as acceleration, for a rotor's inertia
(``rotor_inertia`` among the parameters fitted on request); then windows count while the speed changes too.
"""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sprintlab.core.array_types import FloatArray
from sprintlab.core.checks import check_range
from sprintlab.core.errors import SprintlabError
from sprintlab.workbench.identification.bench import Bench
from sprintlab.workbench.identification.model import STANDING

WINDOW = 0.1
"""Length of a window [s]: long for the noise of a current at 100 Hz, short for the steps of a bench."""

CHANGE = 0.05
"""Share of the log's largest current (or speed) by which a window may change from half to half."""

_FEWEST_ROWS = 4  # rows of a window: two per half
_SEVERAL = 2.0  # rows a window from which a file is a log; steady points are seconds apart
_LARGEST_SHARE = 0.99  # quantile that counts as the largest, so that a spike does not widen the tolerance


def is_log(bench: Bench, window: float = WINDOW) -> bool:
    """Whether the rows follow each other so closely that a window [s] holds several of them."""
    if bench.time is None or bench.size < _FEWEST_ROWS:
        return False
    return float(bench.time[-1] - bench.time[0]) * _SEVERAL <= window * (bench.size - 1)


def rested(bench: Bench, window: float = WINDOW, speed_may_change: bool = False) -> Bench:
    """The steady windows of a log as a bench, one row a window [s]; a remark says what was left out.

    ``speed_may_change`` counts windows while the speed changes, too: the rotor's inertia is fitted.
    """
    check_range("window", window, 1e-3, 60.0, "s")
    if bench.time is None:
        raise SprintlabError("windows need a time column, e.g. 'time [s]'")
    backwards = np.flatnonzero(np.diff(bench.time) < 0.0)
    if len(backwards):
        line = bench.lines[backwards[0] + 1]
        raise SprintlabError(f"the time runs backwards in line {line}: give one recording at a time")
    number = np.floor((bench.time - bench.time[0]) / window).astype(np.int64)
    starts = np.flatnonzero(np.diff(number, prepend=-1))
    counts = np.diff(np.append(starts, bench.size))
    limited = np.add.reduceat(bench.limited.astype(int), starts)
    steady = (counts >= _FEWEST_ROWS) & ((limited == 0) | (limited == counts))
    tolerances = [(bench.current, CHANGE * _largest(bench.current))]
    if bench.speed is not None and not speed_may_change:
        tolerances.append((bench.speed, max(CHANGE * _largest(bench.speed), STANDING)))
    for values, tolerance in tolerances:
        steady &= _changes(values, starts, counts) <= tolerance
    if not steady.any():
        raise SprintlabError(
            f"the log rests nowhere: current or speed change by more than {CHANGE:.0%} of their largest "
            f"value in all {len(counts)} windows of {window:g} s; try shorter ones (--window)"
        )
    remark = (
        f"a log: {int(steady.sum())} of {len(counts)} windows of {window:g} s rest and count, each as one "
        f"row; {bench.size} rows were read"
    )
    return replace(_means(bench, starts[steady], counts[steady]), remarks=(*bench.remarks, remark))


def _largest(values: FloatArray) -> float:
    return float(np.quantile(np.abs(values), _LARGEST_SHARE))


def _changes(values: FloatArray, starts: NDArray[Any], counts: NDArray[Any]) -> FloatArray:
    """Mean of each window's second half less that of its first, without sign; inf where a half is empty."""
    total = np.concatenate(([0.0], np.cumsum(values)))
    middle, end = starts + counts // 2, starts + counts
    with np.errstate(divide="ignore", invalid="ignore"):
        first = (total[middle] - total[starts]) / (middle - starts)
        second = (total[end] - total[middle]) / (end - middle)
    return np.nan_to_num(np.abs(second - first), nan=np.inf)


def _means(bench: Bench, starts: NDArray[Any], counts: NDArray[Any]) -> Bench:
    """One row per window; the acceleration is the least-squares slope of the speed over the time."""

    def mean(values: FloatArray) -> FloatArray:
        total = np.concatenate(([0.0], np.cumsum(values)))
        return (total[starts + counts] - total[starts]) / counts

    given = {item.name: getattr(bench, item.name) for item in fields(bench)}
    averaged = {name: mean(row) for name, row in given.items() if isinstance(row, np.ndarray)}
    if bench.speed is not None and bench.time is not None:
        time = bench.time - bench.time[0]
        together = mean(time * bench.speed) - mean(time) * mean(bench.speed)
        averaged["acceleration"] = together / np.maximum(mean(time**2) - mean(time) ** 2, 1e-12)
    return replace(bench, **averaged | {"limited": bench.limited[starts], "lines": bench.lines[starts]})
