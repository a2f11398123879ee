"""Velocities over time from a file.

CSV: a header ``time,forward`` and optionally ``sideways`` and ``yaw_rate``, then rising times [s]; between
two lines the velocity goes straight. TOML: ``[[segment]]`` tables with ``duration`` [s] and ``forward``,
``sideways``, ``yaw_rate`` (zero where left out), each held for its duration.
"""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np

from sprintlab.core.errors import SprintlabError
from sprintlab.core.reading import parse_toml, read_text, table_number
from sprintlab.deployment.interface import FloatArray, SourceView
from sprintlab.deployment.sources.base import ScriptedSource, Slewed, SourceError

COLUMNS = ("forward", "sideways", "yaw_rate")
_LARGEST_FILE = 4 << 20  # bytes
_FASTEST = 100.0  # [m/s] or [rad/s]


def load_velocity_table(path: Path) -> FloatArray:
    """Read a profile file, ``.csv`` or ``.toml``.

    Returns:
        Time from the start of the run [s], forward, sideways speed [m/s] and yaw rate [rad/s] ``(n, 4)``.

    Raises:
        SourceError: the file cannot be read, or is not of this form.
    """
    readers = {".csv": _read_csv, ".toml": _read_toml}
    if path.suffix.lower() not in readers:
        raise SourceError(f"{path} is no profile file: it must end in {' or '.join(readers)}")
    text = read_text(path, _LARGEST_FILE, what="profile file", error=SourceError)
    try:
        table = np.array(readers[path.suffix.lower()](text), dtype=float)
        _check(table)
    except SprintlabError:
        raise
    except (ValueError, TypeError, AttributeError, csv.Error) as error:
        raise SourceError(f"{path} is not a profile: {error}") from error
    return table


def _check(table: FloatArray) -> None:
    if table.ndim != 2 or len(table) < 2:
        raise ValueError("it needs two points at least")
    if not (np.abs(table[:, 1:]) <= _FASTEST).all():
        raise ValueError(f"a velocity is not a number up to {_FASTEST:g} m/s or rad/s")
    if not (np.diff(table[:, 0], prepend=0.0) >= 0.0).all():
        raise ValueError("its times must rise from 0")


def _read_csv(text: str) -> list[list[float]]:
    reader = csv.reader(text.splitlines(), strict=True)
    names = [name.strip() for name in next(reader, [])]
    if not {"time", "forward"} <= set(names) <= {"time", *COLUMNS} or len(set(names)) < len(names):
        raise ValueError(f"its columns must be time, forward and perhaps sideways, yaw_rate, not {names}")
    rows: list[list[float]] = []
    for cells in reader:
        if len(cells) != len(names):
            raise ValueError(f"line {reader.line_num} has not as many cells as there are columns")
        pairs = zip(names, cells, strict=True)
        row = {name: table_number(cell, name, reader.line_num) for name, cell in pairs}
        rows.append([row.get(name, 0.0) for name in ("time", *COLUMNS)])
    return rows


def _read_toml(text: str) -> list[list[float]]:
    content = parse_toml(text)
    if set(content) != {"segment"}:
        raise ValueError(f"it must hold [[segment]] tables and nothing else, not {sorted(content)}")
    rows: list[list[float]] = []
    end = 0.0
    for segment in content["segment"]:
        if not {"duration"} <= set(segment) <= {"duration", *COLUMNS}:
            raise ValueError(
                f"a segment has a duration and perhaps {', '.join(COLUMNS)}, not {sorted(segment)}"
            )
        velocity = [_number(segment, name) for name in COLUMNS]
        begin, end = end, end + _number(segment, "duration")
        rows += [[begin, *velocity], [end, *velocity]]
    return rows


def _number(segment: dict[str, Any], name: str) -> float:
    value = segment.get(name, 0.0)
    if type(value) not in (int, float):
        raise ValueError(f"{name} is {value!r}, no number")
    return float(value)


class ProfileSource(ScriptedSource):
    """Follows a velocity table from the start of the run, within slew limits: its steps become ramps.

    Args:
        table: as ``load_velocity_table`` gives it ``(n, 4)``.
    """

    def __init__(self, table: FloatArray) -> None:
        super().__init__()
        self._table, self._slewed = table, Slewed()

    def wish(self, view: SourceView) -> FloatArray | None:
        """Velocity ``(3,)``; None after the table's end."""
        time, known = view.running_time or 0.0, self._table[:, 0]
        if time > known[-1]:
            return None
        wish = np.array([np.interp(time, known, column) for column in self._table.T[1:]])
        return self._slewed.follow(wish, view.time)
