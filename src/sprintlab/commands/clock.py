"""When a run begins, at the first command to move, not at the first sample, which still stands; and ends."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Samples = npt.NDArray[np.float64]


def command_start(time: Samples, command: Samples) -> float:
    """Time of the first sample whose command is to move [s], from which a run's clock counts.

    Args:
        time: time of every sample ``(T,)`` [s], rising.
        command: forward speed ``(T,)`` [m/s], or forward, sideways and yaw ``(T, 3)``; of the latter only the
            first two count, since a standing robot may be told to keep its heading.

    Returns:
        That time; the first sample's where nothing is ever commanded.
    """
    asked = np.abs(np.reshape(command, (len(time), -1))[:, :2]).max(axis=1) > 1e-9
    return float(time[int(asked.argmax())])


def finish_time(time: Samples, way: Samples, distance: float) -> float:
    """When a distance was run [s], between two samples straight; ``nan`` when it never was.

    Args:
        time: time of every sample ``(T,)`` [s], rising.
        way: run at every sample ``(T,)`` [m].
        distance: [m].
    """
    reached = way >= distance
    after = int(reached.argmax())
    if not reached[after] or after == 0:
        return float("nan")
    share = (distance - way[after - 1]) / (way[after] - way[after - 1])
    return float(time[after - 1] + share * (time[after] - time[after - 1]))


def race_clock(time: Samples, command: Samples, finish: float) -> Samples:
    """What a stopwatch shows at every sample ``(T,)`` [s]: from the first command to the finish.

    Args:
        time: time of every sample ``(T,)`` [s], rising.
        command: as for ``command_start``.
        finish: moment at which the distance was reached, or the last sample's [s].
    """
    start = command_start(time, command)
    return np.clip(time, start, max(finish, start)) - start
