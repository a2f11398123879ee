"""The bench files that ``tools/fetch_bench_data.py`` made, and parts of them."""

from __future__ import annotations

import csv
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sprintlab.core.errors import SprintlabError
from sprintlab.core.reading import read_text
from sprintlab.workbench.identification import Bench, behind_gear, load_bench, rested

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

HEJ90_RATIO = 4761.0 / 169.0
"""Gear of the HEJ-90 joint, as its authors print it."""


IDLE = 0.15
"""Current below which a motor counts as idle [A]: the sensor's zero is read there."""

LARGEST_D_CURRENT = 5.0
"""i_d beyond which a row of the D5065 is no steady point [A]: its drive asks for none."""


_TABLE_LIMIT = 32 << 20  # [bytes]


def shaft(folder: Path, name: str, role: str = "") -> Bench:
    """Steady windows of an RI50 log, its torque sensor zeroed where both motors idle in the same log.

    The magnets' drift is not asked of it: the temperature is that of one of the two motors.
    """
    whole = rested(load_bench(present(folder, f"ri50-{name}.csv")))
    zero = float(np.median(whole.torque[np.abs(whole.current) < IDLE]))
    bench = rested(load_bench(present(folder, f"ri50-{name}-{role}.csv"))) if role else whole
    return replace(bench, torque=bench.torque - zero, temperature=None)


def points(folder: Path) -> Bench:
    """The D5065's steady points, without the few whose i_d ran away, and without the drive's power."""
    bench = load_bench(present(folder, "d5065-points.csv"))
    steady = part(bench, np.abs(bench.d_current) <= LARGEST_D_CURRENT)
    return replace(steady, temperature=None, power=None)


def joint(folder: Path, name: str) -> Bench:
    """Every update of a HEJ-90 log, referred to the motor's shaft."""
    return behind_gear(load_bench(present(folder, f"hej90-{name}.csv")), HEJ90_RATIO)


def columns(folder: Path, name: str) -> dict[str, FloatArray]:
    """A converted table that is no bench, by heading."""
    path = present(folder, name)
    lines = read_text(path, _TABLE_LIMIT, what="table").splitlines()
    try:
        rows = list(csv.reader(line for line in lines if not line.startswith("#")))
        numbers = np.array(rows[1:], dtype=float)
        return {heading: numbers[:, index] for index, heading in enumerate(rows[0])}
    except (csv.Error, ValueError, IndexError) as error:
        raise SprintlabError(f"{path} is not a table of numbers: {error}") from error


def present(folder: Path, name: str) -> Path:
    """The file's path; raises ``SprintlabError`` if it was not converted yet."""
    path = folder / name
    if not path.is_file():
        source = name.partition("-")[0]
        raise SprintlabError(
            f"{path} is missing: python tools/fetch_bench_data.py {source} CLONE --output {folder}"
        )
    return path


def part(bench: Bench, wanted: BoolArray) -> Bench:
    """The rows for which ``wanted`` is true."""
    chosen = {
        name.name: value[wanted]
        for name in fields(bench)
        if isinstance(value := getattr(bench, name.name), np.ndarray)
    }
    return replace(bench, **chosen)


def halves(bench: Bench, chosen: BoolArray) -> tuple[Bench, Bench]:
    """The rows that are chosen, and the rest."""
    return part(bench, chosen), part(bench, ~chosen)
