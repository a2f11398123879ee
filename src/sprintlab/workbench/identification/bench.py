"""Bench data: one operating point a row, every column with its unit in the header.

A header cell is a name and a unit in brackets, e.g. ``speed [rpm],iq [A],torque [N m]``. Currents and
voltages are amplitudes in the rotor's frame (amplitude-invariant), torque is what the shaft gives, positive
with positive current, speed is mechanical.
"""

from __future__ import annotations

import csv
import math
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sprintlab.core.array_types import FloatArray
from sprintlab.core.checks import check_choice, check_range
from sprintlab.core.errors import InvalidValueError, SprintlabError
from sprintlab.core.reading import plain_number, read_text

_AMPERE = {"A": 1.0, "mA": 1e-3}
_VOLT = {"V": 1.0, "mV": 1e-3}
COLUMNS: dict[str, Mapping[str, float]] = {
    "speed": {"rad/s": 1.0, "rpm": 2.0 * math.pi / 60.0},
    "iq": _AMPERE,
    "id": _AMPERE,
    "phase_current": {"A amplitude": 1.0, "A rms": math.sqrt(2.0)},
    "torque": {"N m": 1.0, "mN m": 1e-3, "N cm": 1e-2},
    "vq": _VOLT,
    "vd": _VOLT,
    "power": {"W": 1.0, "kW": 1e3},
    "bus_voltage": _VOLT,
    "temperature": {"degC": 1.0},
    "limited": {"": 1.0},
    "time": {"s": 1.0, "ms": 1e-3},
}
"""Known columns and their units, as SI factors; ``limited`` is 1 where the inverter gives all its voltage."""

MEANINGS = {
    "speed": "mechanical speed of the motor's shaft",
    "iq": "q-axis current, or phase_current",
    "torque": "torque on the shaft",
}
_UNIT_ALIASES = {"1/min": "rpm", "u/min": "rpm", "r/min": "rpm", "c": "degc"}
_ALIASES = {"iq": "iq", "id": "id", "vq": "vq", "vd": "vd", "omega": "speed", "vbus": "bus_voltage"}
_HEADER = re.compile(r"\s*([^\[\]()]+?)\s*(?:[\[(]([^\])]*)[\])])?\s*")
BENCH_LIMIT = 32 << 20
"""Largest bench file that is read [bytes]."""
MOST_ROWS = 100_000
"""Most operating points of a bench."""
_LONGEST_LINE = 4000
_LONGEST_HEADING = 100
_LARGEST = {"speed": 1e5, "torque": 1e5, "time": 1e10}  # a clock may count from 1970
_LARGEST_OTHER = 1e6  # [A], [V], [degC], [s]
_MOST_TITLES = 10  # lines above a header
_LISTED = 4  # differing values that an error shows
_HOTTEST = 250.0  # [degC]: beyond, the temperatures are in kelvin or of another thing


@dataclass(frozen=True, kw_only=True)
class Bench:
    """Steady operating points in SI, every array ``(n,)``.

    Attributes:
        current: i_q, amplitude [A].
        torque: shaft torque [N m].
        speed: mechanical speed [rad/s]; ``None`` in a torque-current table.
        d_current: i_d [A]; zero where the bench has no such column.
        q_voltage: v_q [V] or ``None``.
        d_voltage: v_d [V] or ``None``.
        power: electrical, into the three phases [W], or ``None``.
        bus_voltage: DC bus [V] or ``None``.
        temperature: temperature of the winding [degC] or ``None``.
        limited: the inverter gives all its voltage, bool.
        time: time in a log [s] or ``None``: rows that follow each other closely (``transients``).
        acceleration: acceleration of the shaft [rad/s^2] or ``None``, of a log's windows.
        lines: line of each row in its file, to name it.
        unused: columns that were not understood and not read.
        remarks: what was done to the rows before a fit, which a reader must know.
    """

    current: FloatArray
    torque: FloatArray
    speed: FloatArray | None = None
    d_current: FloatArray
    q_voltage: FloatArray | None = None
    d_voltage: FloatArray | None = None
    power: FloatArray | None = None
    bus_voltage: FloatArray | None = None
    temperature: FloatArray | None = None
    limited: NDArray[np.bool_]
    time: FloatArray | None = None
    acceleration: FloatArray | None = None
    lines: NDArray[np.int64]
    unused: tuple[str, ...] = field(default=())
    remarks: tuple[str, ...] = field(default=())

    @property
    def size(self) -> int:
        """Number of rows."""
        return len(self.current)


def load_bench(path: str | os.PathLike[str], needs_speed: bool = True, columns: Sequence[str] = ()) -> Bench:
    """Read a bench file: comma, semicolon or tab between the cells; lines that begin with # are remarks.

    Where no comma parts the cells, numbers may have decimal commas. Lines above the header in which no column
    is known are skipped.

    Args:
        path: the file.
        needs_speed: whether a missing speed column is an error.
        columns: ``name=heading`` or ``name=heading:unit`` for columns that the file calls otherwise.

    Raises:
        SprintlabError: the file cannot be read, or a line has cells too many, too few, or with no finite
            number (it is named).
        InvalidValueError: a column is missing, given twice, has no or an unknown unit, or values that
            cannot be.
    """
    mapping = dict(_mapped(entry) for entry in columns)
    lines = _from_header(_read_lines(Path(path)), mapping)
    number, header = lines[0]
    names = _read_header(path, _renamed(path, header, mapping))
    rows = lines[1:]
    if not rows:
        raise SprintlabError(f"{path} has a header in line {number} and no data")
    _check_cells(path, rows, len(header))
    values = {
        name: factor * _column(path, rows, index, header[index]) for name, (index, factor) in names.items()
    }
    for name in ("speed", "torque") if needs_speed else ("torque",):
        _require(path, name, values, header)
    if "phase_current" not in values:
        _require(path, "iq", values, header)
    return _assemble(path, values, [line for line, _ in rows], _unused(header, names))


def behind_gear(bench: Bench, ratio: float, motor_speed: bool = False) -> Bench:
    """The bench referred to the motor's shaft, of torques (and speeds) measured behind a gear.

    Args:
        bench: as measured.
        ratio: motor speed over output speed.
        motor_speed: the speed is the motor's already.

    Raises:
        InvalidValueError: a ratio outside [1, 500].
    """
    check_range("gear_ratio", ratio, 1.0, 500.0)
    torque = bench.torque / ratio
    if motor_speed or bench.speed is None:
        return replace(bench, torque=torque)
    acceleration = None if bench.acceleration is None else bench.acceleration * ratio
    return replace(bench, torque=torque, speed=bench.speed * ratio, acceleration=acceleration)


def _read_lines(path: Path) -> list[tuple[int, list[str]]]:
    """Line numbers and cells of everything that is no remark."""
    text = read_text(path, BENCH_LIMIT, what="bench file")
    kept = [
        (number, line)
        for number, line in enumerate(text.splitlines(), 1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not kept:
        raise SprintlabError(f"{path} is empty")
    if max(len(line) for _, line in kept) > _LONGEST_LINE or len(kept) > MOST_ROWS:
        raise SprintlabError(
            f"{path} is no bench file: it has more than {MOST_ROWS} lines, or one of more than "
            f"{_LONGEST_LINE} characters"
        )
    titles = [line for _, line in kept[:_MOST_TITLES]]
    separator = next((mark for mark in ";\t" if sum(mark in line for line in titles) * 2 > len(titles)), ",")
    cells = [(number, next(csv.reader([line], delimiter=separator))) for number, line in kept]
    return cells if separator == "," else _with_decimal_points(path, cells)


def _with_decimal_points(path: object, lines: list[tuple[int, list[str]]]) -> list[tuple[int, list[str]]]:
    """Decimal commas as points, in files whose cells no comma parts."""
    rows = lines[1:]
    text = "".join("".join(cells) for _, cells in rows)
    if "," in text and "." in text:
        raise SprintlabError(f"{path} has decimal commas and decimal points: write all numbers with points")
    return lines[:1] + [(number, [cell.replace(",", ".") for cell in cells]) for number, cells in rows]


def _mapped(entry: str) -> tuple[str, tuple[str, str]]:
    """``(heading, (name, unit))`` of one entry ``name=heading:unit``."""
    name, equals, rest = entry.partition("=")
    heading, _, unit = rest.rpartition(":") if ":" in rest else (rest, "", "")
    check_choice("column", name.strip(), tuple(COLUMNS))
    if not equals or not heading.strip():
        raise InvalidValueError("column", entry, "write name=heading or name=heading:unit, e.g. iq=current:A")
    return heading.strip().casefold(), (name.strip(), unit.strip())


def _from_header(
    lines: list[tuple[int, list[str]]], mapping: Mapping[str, tuple[str, str]]
) -> list[tuple[int, list[str]]]:
    """The lines from the header on: the first in which a column is known; all of them if none is."""
    for index, (_, cells) in enumerate(lines[:_MOST_TITLES]):
        if any(cell.strip().casefold() in mapping or _names_column(cell) for cell in cells):
            return lines[index:]
    return lines


def _names_column(cell: str) -> bool:
    match = _HEADER.fullmatch(cell) if len(cell) <= _LONGEST_HEADING else None
    return match is not None and _known_name(match[1]) is not None


def _renamed(path: object, header: Sequence[str], mapping: Mapping[str, tuple[str, str]]) -> list[str]:
    """The header with mapped headings in our names; a unit that the mapping leaves out is the heading's."""
    there = {cell.strip().casefold() for cell in header}
    for heading, (name, _) in mapping.items():
        if heading not in there:
            raise InvalidValueError(f"{path}: column {name}", heading, f"the header has {', '.join(header)}")
    names = {name for name, _ in mapping.values()}
    renamed: list[str] = []
    for cell in header:
        name, unit = mapping.get(cell.strip().casefold(), ("", ""))
        match = _HEADER.fullmatch(cell) if len(cell) <= _LONGEST_HEADING else None
        if name:
            written = unit or (match[2] if match else None) or ""
            renamed.append(f"{name} [{written}]" if written else name)
        else:  # a mapped column stands in for one that bears its name
            hidden = match is not None and _known_name(match[1]) in names
            renamed.append("" if hidden else cell)
    return renamed


def _check_cells(path: object, rows: Sequence[tuple[int, list[str]]], columns: int) -> None:
    for line, cells in rows:
        filled = len("\t".join(cells).rstrip().split("\t"))
        if filled > columns:
            raise SprintlabError(
                f"{path} line {line} has {filled} cells, the header {columns}: with decimal commas, part the "
                "cells with semicolons"
            )


def _read_header(path: object, header: Sequence[str]) -> dict[str, tuple[int, float]]:
    """Position and SI factor of every known column."""
    found: dict[str, tuple[int, float]] = {}
    for index, cell in enumerate(header):
        if len(cell) > _LONGEST_HEADING:  # the time to take one apart grows with the cube of its length
            raise InvalidValueError(f"{path}: column", cell[:40], f"at most {_LONGEST_HEADING} characters")
        match = _HEADER.fullmatch(cell)
        name = _known_name(match[1]) if match else None
        if match is None or name is None or (name == "time" and not match[2]):
            continue  # a time in any form may be there; only one with a unit makes a log
        if name in found:
            raise InvalidValueError(f"{path}: column {name}", cell, "is given twice")
        found[name] = (index, _unit_factor(path, name, cell, match[2] or ""))
    return found


def _known_name(text: str) -> str | None:
    plain = re.sub(r"[\s_]+", "_", text.strip().casefold())
    for name in (plain, _ALIASES.get(plain.replace("_", ""), "")):
        if name in COLUMNS:
            return name
    return None


def _unit_factor(path: object, name: str, cell: str, unit: str) -> float:
    units = COLUMNS[name]
    plain = {known.replace(" ", "").casefold(): factor for known, factor in units.items()}
    written = re.sub(r"[\s·*.]", "", unit).replace("°", "deg").casefold()
    written = _UNIT_ALIASES.get(written, written)
    if written not in plain:
        allowed = " or ".join(f"'{name} [{known}]'" for known in units)
        raise InvalidValueError(f"{path}: column", cell, f"write the unit in the header: {allowed}")
    return plain[written]


def _column(path: object, rows: Sequence[tuple[int, list[str]]], index: int, title: str) -> FloatArray:
    numbers = np.empty(len(rows))
    for position, (line, cells) in enumerate(rows):
        try:
            numbers[position] = plain_number(cells[index])
        except (ValueError, IndexError):
            written = cells[index] if index < len(cells) else "nothing"
            raise SprintlabError(
                f"{path} line {line}: {title.strip()} is {written!r}, not a finite number"
            ) from None
    return numbers


def _require(path: object, name: str, values: Mapping[str, Any], header: Sequence[str]) -> None:
    if name not in values:
        headings = " or ".join(f"'{name} [{unit}]'" for unit in COLUMNS[name])
        mapping = f'or say which it is with --column "{name}=HEADING:{next(iter(COLUMNS[name]))}"'
        table = "; --saturation-only takes a torque-current table" if name == "speed" else ""
        raise InvalidValueError(
            f"{path}: columns",
            ", ".join(header),
            f"{name} is missing ({MEANINGS[name]}): write {headings}, {mapping}{table}",
        )


def _unused(header: Sequence[str], names: Mapping[str, tuple[int, float]]) -> tuple[str, ...]:
    used = {index for index, _ in names.values()}
    return tuple(cell.strip() for index, cell in enumerate(header) if index not in used)


def _assemble(
    path: object, values: Mapping[str, FloatArray], lines: Sequence[int], unused: tuple[str, ...]
) -> Bench:
    for name, column in values.items():
        most = _LARGEST.get(name, _LARGEST_OTHER)
        _check_values(
            path, name, column, np.abs(column) <= most, f"at most {most:g} in SI units is plausible"
        )
    torque = values["torque"]
    current = values.get("iq")
    if current is None:
        # With i_d = 0 the phase current's amplitude is |i_q|; its direction is the torque's.
        current = np.abs(values["phase_current"]) * np.where(torque < 0, -1.0, 1.0)
    limited = values.get("limited", np.zeros(len(torque)))
    _check_values(path, "limited", limited, np.isin(limited, (0.0, 1.0)), "must be 0 or 1")
    for name, low, high, allowed in (
        ("bus_voltage", 1e-9, math.inf, "must be greater than 0"),
        ("temperature", -100.0, _HOTTEST, f"must lie between -100 and {_HOTTEST:g} degC: is it in kelvin?"),
    ):
        column = values.get(name)
        if column is not None:
            _check_values(path, name, column, (column >= low) & (column <= high), allowed)
    return Bench(
        current=current,
        torque=torque,
        speed=values.get("speed"),
        d_current=values.get("id", np.zeros(len(torque))),
        q_voltage=values.get("vq"),
        d_voltage=values.get("vd"),
        power=values.get("power"),
        bus_voltage=values.get("bus_voltage"),
        temperature=values.get("temperature"),
        time=values.get("time"),
        limited=limited.astype(bool),
        lines=np.asarray(lines, dtype=np.int64),
        unused=unused,
    )


def _check_values(path: object, name: str, values: FloatArray, fine: NDArray[np.bool_], allowed: str) -> None:
    if not fine.all():
        wrong = sorted(set(values[~fine].tolist()))[:_LISTED]
        raise InvalidValueError(f"{path}: column {name}", ", ".join(f"{value:g}" for value in wrong), allowed)
