"""Velocities over time from a file.

CSV: a header ``time,forward`` and optionally ``sideways`` and ``yaw_rate``, then rising times [s]; between
two lines the velocity goes straight. TOML: ``[[segment]]`` tables with ``duration`` [s] and ``forward``,
``sideways``, ``yaw_rate`` (zero where left out), each held for its duration.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sprintlab.core.errors import InvalidValueError
from sprintlab.core.reading import TEXT_LIMIT, parse_toml, read_text, table_number
from sprintlab.deployment.interface import FloatArray, SourceView
from sprintlab.deployment.sources.script import ScriptedSource
from sprintlab.deployment.sources.slew import Slewed, SlewLimits, SourceError

PROFILE_LIMIT = 4 << 20
"""Largest profile file in CSV that is read [bytes]; one in TOML has ``TEXT_LIMIT``."""
_FASTEST = 100.0  # [m/s] or [rad/s]
_LONGEST = 1e6  # [s]

COLUMNS = ("forward", "sideways", "yaw_rate")


@dataclass(frozen=True, kw_only=True)
class VelocityTable:
    """Velocity over time, straight between its points.

    Attributes:
        time: ``(n,)`` rising, from the start of the run [s].
        velocity: ``(n, 3)`` forward, sideways [m/s], yaw rate [rad/s].

    Raises:
        InvalidValueError: fewer than two points, a number that is not finite, or times that fall.
    """

    time: FloatArray
    velocity: FloatArray

    def __post_init__(self) -> None:
        if len(self.time) < 2 or self.velocity.shape != (len(self.time), 3):
            raise InvalidValueError("profile", self.velocity.shape, "two points at least, three numbers each")
        if not (np.isfinite(self.time).all() and np.isfinite(self.velocity).all()):
            raise InvalidValueError("profile", "nan", "must be finite numbers")
        if np.abs(self.velocity).max() > _FASTEST or np.abs(self.time).max() > _LONGEST:
            largest = float(np.abs(self.velocity).max())
            raise InvalidValueError(
                "profile", largest, f"at most {_FASTEST:g} m/s or rad/s, and {_LONGEST:g} s"
            )
        if (np.diff(self.time) < 0.0).any() or self.time[0] < 0.0:
            raise InvalidValueError("profile.time", self.time[:8].tolist(), "must rise from 0")

    def at(self, time: float) -> FloatArray | None:
        """Velocity ``(3,)`` at ``time`` [s]; None after the end."""
        if time > self.time[-1]:
            return None
        return np.array([np.interp(time, self.time, column) for column in self.velocity.T])


def load_velocity_table(path: Path) -> VelocityTable:
    """Read a profile file, ``.csv`` or ``.toml``.

    Raises:
        SourceError: the file cannot be read, or is not of this form.
        InvalidValueError: its numbers make no sense.
    """
    readers = {".csv": (_read_csv, PROFILE_LIMIT), ".toml": (_read_toml, TEXT_LIMIT)}
    if path.suffix.lower() not in readers:
        raise SourceError(f"{path} is no profile file: it must end in {' or '.join(readers)}")
    reader, limit = readers[path.suffix.lower()]
    text = read_text(path, limit, what="profile file", error=SourceError)
    try:
        time, velocity = reader(text)
    except (ValueError, TypeError, KeyError, AttributeError, OverflowError, csv.Error) as error:
        raise SourceError(f"{path} is no profile file: {error}") from error
    # Column by column: the control loop looks numbers up, and NumPy would copy columns of rows each time.
    columns = np.array(velocity, dtype=float, order="F")
    return VelocityTable(time=np.asarray(time, dtype=float), velocity=columns)


def _read_csv(text: str) -> tuple[Sequence[float], Sequence[Sequence[float]]]:
    reader = csv.DictReader(text.splitlines(), strict=True)
    names = [name.strip() for name in reader.fieldnames or ()]
    unknown = set(names) - {"time", *COLUMNS}
    if not {"time", "forward"} <= set(names) or unknown:
        raise ValueError(f"its columns must be time, forward and perhaps sideways, yaw_rate, not {names}")
    reader.fieldnames = names
    if len(set(names)) < len(names):
        raise ValueError(f"a column stands twice in it: {names}")
    rows = [_csv_row(row, reader.line_num) for row in reader]
    return [row["time"] for row in rows], [[row.get(name, 0.0) for name in COLUMNS] for row in rows]


def _csv_row(row: dict[str, str], line: int) -> dict[str, float]:
    if None in row or None in row.values():  # more cells than the header has names, or less
        raise ValueError(f"line {line} has not as many cells as there are columns")
    return {name: table_number(cell, name, line) for name, cell in row.items()}


def _read_toml(text: str) -> tuple[list[float], list[list[float]]]:
    content = parse_toml(text)
    if set(content) != {"segment"}:
        raise ValueError(f"it must hold [[segment]] tables and nothing else, not {sorted(content)}")
    time, velocity, end = [], [], 0.0
    for segment in content["segment"]:
        held = _segment_velocity(segment)
        time += [end, end + _plain(segment, "duration")]
        velocity += [held, held]
        end = time[-1]
    return time, velocity


def _segment_velocity(segment: dict[str, Any]) -> list[float]:
    unknown = set(segment) - {"duration", *COLUMNS}
    if unknown or "duration" not in segment:
        raise ValueError(f"a segment has a duration and perhaps {', '.join(COLUMNS)}, not {sorted(segment)}")
    return [_plain(segment, name) for name in COLUMNS]


def _plain(segment: dict[str, Any], name: str) -> float:
    value = segment.get(name, 0.0)
    if type(value) not in (int, float):
        raise ValueError(f"{name} is {value!r}, no number")
    return float(value)


class ProfileSource(ScriptedSource):
    """Follows a velocity table from the start of the run, within slew limits.

    Args:
        table: velocity over time.
        limits: slew limits: a file's steps become ramps.
    """

    def __init__(self, table: VelocityTable, limits: SlewLimits | None = None) -> None:
        super().__init__()
        self._table = table
        self._slewed = Slewed(limits or SlewLimits())

    def wish(self, view: SourceView) -> FloatArray | None:
        """Velocity ``(3,)``; None after the table's end."""
        wish = self._table.at(view.running_time or 0.0)
        return None if wish is None else self._slewed.follow(wish, view.time)
