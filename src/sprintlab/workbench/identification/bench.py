"""Bench files: measured points of a motor, each column named by its header with the unit; SI inside."""

from __future__ import annotations

import csv
import math
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sprintlab.core.array_types import FloatArray
from sprintlab.core.checks import check_choice, check_range
from sprintlab.core.errors import InvalidValueError, SprintlabError
from sprintlab.core.reading import finite_number, read_text
from sprintlab.workbench.units import AMPERE, SPEED, VOLT, unit_factor

COLUMNS: dict[str, Mapping[str, float]] = {
    "speed": SPEED,
    "iq": AMPERE,
    "id": AMPERE,
    "phase_current": {"A amplitude": 1.0, "A rms": math.sqrt(2.0)},
    "torque": {"N m": 1.0, "mN m": 1e-3, "N cm": 1e-2},
    "vq": VOLT,
    "vd": VOLT,
    "power": {"W": 1.0, "kW": 1e3},
    "bus_voltage": VOLT,
    "temperature": {"degC": 1.0},
    "limited": {"": 1.0},
    "time": {"s": 1.0, "ms": 1e-3},
}
"""Known columns and their units, as SI factors; ``limited`` is 1 where the inverter gives all its voltage."""

_MEANINGS = {
    "speed": "mechanical speed of the motor's shaft",
    "iq": "q-axis current, or phase_current",
    "torque": "torque on the shaft",
}
_ALIASES = {"omega": "speed", "vbus": "bus_voltage", "i_q": "iq", "i_d": "id", "v_q": "vq", "v_d": "vd"}
_RANGES = {
    # lowest and highest value in SI; a clock may count from 1970
    "speed": (-1e5, 1e5),
    "torque": (-1e5, 1e5),
    "time": (-1e10, 1e10),
    "bus_voltage": (1e-9, 1e6),
    "temperature": (-100.0, 250.0),  # kelvin lie above
}
_OTHER_RANGE = (-1e6, 1e6)
_BENCH_LIMIT = 32 << 20  # bytes

Cells = tuple[int, list[str]]
"""Number of a line, and its cells."""


@dataclass(frozen=True, kw_only=True)
class Bench:
    """Steady operating points in SI, every array ``(n,)``; ``None`` for a column that is not there."""

    current: FloatArray  # i_q, amplitude [A]
    torque: FloatArray  # On the shaft [N m]
    speed: FloatArray | None = None  # Mechanical [rad/s]; ``None`` in a torque-current table
    d_current: FloatArray  # i_d [A]; zero where the bench has no such column
    q_voltage: FloatArray | None = None  # v_q [V]
    d_voltage: FloatArray | None = None  # v_d [V]
    power: FloatArray | None = None  # Electrical, into the three phases [W]
    bus_voltage: FloatArray | None = None  # DC bus [V]
    temperature: FloatArray | None = None  # Temperature of the winding [degC]
    limited: NDArray[np.bool_]  # Whether the inverter gives all its voltage
    time: FloatArray | None = None  # Time in a log [s]: rows that follow each other closely (``transients``)
    acceleration: FloatArray | None = None  # Acceleration of the shaft in a log's windows [rad/s^2]
    lines: NDArray[np.int64]  # Line of each row in its file, to name it
    unused: tuple[str, ...] = ()  # Columns that were not understood and not read
    remarks: tuple[str, ...] = ()  # What was done to the rows before a fit, which a reader must know

    @property
    def size(self) -> int:
        """Number of rows."""
        return len(self.current)


def load_bench(path: str | os.PathLike[str], needs_speed: bool = True, columns: Sequence[str] = ()) -> Bench:
    """Read a bench file: comma, semicolon or tab between the cells; lines that begin with # are remarks.

    Where no comma parts the cells, numbers may have decimal commas. ``columns`` are ``name=heading`` or
    ``name=heading:unit`` for columns that the file calls otherwise.
    """
    mapping = dict(_mapped(entry) for entry in columns)
    (number, header), *rows = _read_cells(Path(path))
    places = _places(path, header, mapping)
    if not rows:
        raise SprintlabError(f"{path} has a header in line {number} and no data")
    needed = ("speed", "iq", "torque") if needs_speed else ("iq", "torque")
    for name in needed:
        if name not in places and not (name == "iq" and "phase_current" in places):
            raise _missing(path, name, header)
    values = {name: factor * _numbers(path, rows, index, header) for name, (index, factor) in places.items()}
    used = {index for index, _ in places.values()}
    unused = tuple(cell.strip() for index, cell in enumerate(header) if index not in used)
    return _assembled(path, values, [line for line, _ in rows], unused)


def behind_gear(bench: Bench, ratio: float, motor_speed: bool = False) -> Bench:
    """The bench on the motor's shaft, of torques (and, without ``motor_speed``, speeds) behind a gear."""
    check_range("gear_ratio", ratio, 1.0, 500.0)
    bench = replace(bench, torque=bench.torque / ratio)
    if motor_speed or bench.speed is None:
        return bench
    acceleration = None if bench.acceleration is None else bench.acceleration * ratio
    return replace(bench, speed=bench.speed * ratio, acceleration=acceleration)


def _read_cells(path: Path) -> list[Cells]:
    """Every line that is no remark, as cells with decimal points."""
    lines = enumerate(read_text(path, _BENCH_LIMIT, what="bench file").splitlines(), 1)
    kept = [(number, line) for number, line in lines if line.strip() and not line.lstrip().startswith("#")]
    if not kept:
        raise SprintlabError(f"{path} is empty")
    separator = next((mark for mark in ";\t" if mark in kept[0][1]), ",")
    try:
        cells = [(number, next(csv.reader([line], delimiter=separator))) for number, line in kept]
    except csv.Error as error:
        raise SprintlabError(f"{path} is not a bench file: {error}") from error
    if separator == ",":
        return cells
    return cells[:1] + [(number, [cell.replace(",", ".") for cell in row]) for number, row in cells[1:]]


def _mapped(entry: str) -> tuple[str, tuple[str, str]]:
    """``(heading, (name, unit))`` of one entry ``name=heading:unit``."""
    name, equals, rest = entry.partition("=")
    heading, _, unit = rest.rpartition(":") if ":" in rest else (rest, "", "")
    check_choice("column", name.strip(), tuple(COLUMNS))
    if not equals or not heading.strip():
        raise InvalidValueError("column", entry, "write name=heading or name=heading:unit, e.g. iq=current:A")
    return heading.strip().casefold(), (name.strip(), unit.strip())


def _parted(cell: str) -> tuple[str, str]:
    """Name and unit of a heading such as ``Speed [rad/s]`` or ``speed (rad/s)``, or two empty texts."""
    match = re.fullmatch(r"([^\[\]()]*)(?:[\[(]([^\[\]()]*)[\])])?\s*", cell)
    name = re.sub(r"[\s_]+", "_", match[1].strip().casefold()) if match else ""
    return _ALIASES.get(name, name), ((match[2] or "") if match else "").strip()


def _places(
    path: object, header: Sequence[str], mapping: Mapping[str, tuple[str, str]]
) -> dict[str, tuple[int, float]]:
    """Position and SI factor of every known column; a mapped one stands in for one that bears its name."""
    headings = [cell.strip().casefold() for cell in header]
    for heading, (name, _) in mapping.items():
        if heading not in headings:
            raise InvalidValueError(f"{path}: column {name}", heading, f"the header has {', '.join(header)}")
    hidden, found = {name for name, _ in mapping.values()}, dict[str, tuple[int, float]]()
    for index, (heading, cell) in enumerate(zip(headings, header, strict=True)):
        name, unit = _parted(cell)
        if heading in mapping:
            name, unit = mapping[heading][0], mapping[heading][1] or unit
        elif name in hidden or name not in COLUMNS or (name == "time" and not unit):
            continue  # a time in any form may be there; only one with a unit makes a log
        if name in found:
            raise InvalidValueError(f"{path}: column {name}", cell, "is given twice")
        found[name] = (index, _unit_factor(path, name, cell, unit))
    return found


def _unit_factor(path: object, name: str, cell: str, unit: str) -> float:
    factor = unit_factor(COLUMNS[name], unit)
    if math.isnan(factor):
        allowed = " or ".join(f"'{name} [{known}]'" for known in COLUMNS[name])
        raise InvalidValueError(f"{path}: column", cell, f"write the unit in the header: {allowed}")
    return factor


def _missing(path: object, name: str, header: Sequence[str]) -> InvalidValueError:
    headings = " or ".join(f"'{name} [{unit}]'" for unit in COLUMNS[name])
    mapping = f'or say which it is with --column "{name}=HEADING:{next(iter(COLUMNS[name]))}"'
    table = "; --saturation-only takes a torque-current table" if name == "speed" else ""
    allowed = f"{name} is missing ({_MEANINGS[name]}): write {headings}, {mapping}{table}"
    return InvalidValueError(f"{path}: columns", ", ".join(header), allowed)


def _numbers(path: object, rows: Sequence[Cells], index: int, header: Sequence[str]) -> FloatArray:
    """One column ``(n,)`` in the file's unit."""
    numbers = np.empty(len(rows))
    for position, (line, cells) in enumerate(rows):
        if any(cell.strip() for cell in cells[len(header) :]):
            raise SprintlabError(
                f"{path} line {line} has {len(cells)} cells, the header {len(header)}: with decimal commas, "
                "part the cells with semicolons"
            )
        try:
            numbers[position] = finite_number("".join(cells[index : index + 1]))
        except ValueError as error:
            raise SprintlabError(f"{path} line {line}, column {header[index].strip()}: {error}") from None
    return numbers


def _assembled(
    path: object, values: Mapping[str, FloatArray], lines: Sequence[int], unused: tuple[str, ...]
) -> Bench:
    """The bench of checked columns; with i_d = 0 the phase current is |i_q| and points as the torque does."""
    for name, column in values.items():
        low, high = _RANGES.get(name, _OTHER_RANGE)
        hint = " degC: is it in kelvin?" if name == "temperature" else " in SI units"
        allowed = f"must lie between {low:g} and {high:g}{hint}"
        _check_values(path, name, column, (column >= low) & (column <= high), allowed)
    torque = values["torque"]
    current = values.get("iq")
    if current is None:
        current = np.abs(values["phase_current"]) * np.where(torque < 0, -1.0, 1.0)
    limited = values.get("limited", np.zeros(len(torque)))
    _check_values(path, "limited", limited, np.isin(limited, (0.0, 1.0)), "must be 0 or 1")
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
        wrong = ", ".join(f"{value:g}" for value in sorted(set(values[~fine].tolist()))[:4])
        raise InvalidValueError(f"{path}: column {name}", wrong, allowed)
