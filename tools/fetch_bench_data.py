"""Motor benches measured by others, as bench files of ours: ``python tools/fetch_bench_data.py ri50 CLONE``.

None of these data may be copied into this project (three sources have no licence, one is GPL), so nothing is
downloaded and nothing is committed: clone a source yourself and give its path. Files are read at the commit
that our results name, whatever is checked out. They are converted into ``--output``, on which
``python -m studies.benches`` works.
"""

from __future__ import annotations

import argparse
import ast
import csv
import io
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sprintlab.core.errors import SprintlabError
from sprintlab.core.files import atomic_write_text

Table = dict[str, NDArray[np.float64]]
Tables = dict[str, Table]

REFUSED = 2
HOLD = 15
"""Rows of a HEJ-90 log between two updates of its signals: 1 kHz written, 67 Hz measured."""


@dataclass(frozen=True)
class Source:
    """One repository.

    Attributes:
        repository: on GitHub, owner/name.
        commit: commit at which the files are read.
        terms: what its licence allows.
        folder: the files' folder inside the repository.
        files: name of the file, by our name of its table.
        convert: a file's text and our name of it -> tables by name.
    """

    repository: str
    commit: str
    terms: str
    folder: str
    files: dict[str, str]
    convert: Callable[[str, str], Tables]


def ri50_tables(text: str, name: str) -> Tables:
    """A log of two moteus drives on one shaft: a table for each motor and what it does, driving or braking.

    Both motors count their own current and speed; the torque sensor between them reads positive where either
    motor's current is positive.
    """
    rows = list(csv.reader(line for line in text.splitlines() if not line.startswith("#")))
    columns = _columns(rows[0], rows[1:])
    torque = next(values for heading, values in columns.items() if heading.startswith("trs605"))
    tables: Tables = {}
    for motor, other in (("1", "2"), ("2", "1")):
        asked = {which: np.abs(columns[f"a{which} q-axis cmd [A]"]) > 0.01 for which in (motor, other)}
        table = {
            "time [s]": columns["time [s]"],
            "iq [A]": columns[f"a{motor} q-axis [A]"],
            "speed [rad/s]": columns[f"a{motor} velocity [rad/s]"],
            "torque [N m]": torque,
            "temperature [degC]": columns["motor temp [C]"],
            "estimate of the drive [N m]": columns[f"c{motor} torque [Nm]"],
        }
        tables[f"{name}-{motor}"] = table
        for role, commanded in (("drives", asked[motor]), ("brakes", asked[other])):
            tables[f"{name}-{motor}-{role}"] = {
                heading: values[commanded] for heading, values in table.items()
            }
    return tables


def d5065_tables(text: str, name: str) -> Tables:
    """A table of steady points: a date, headings, units, numbers; the torque is in N mm."""
    rows = list(csv.reader(text.splitlines(), skipinitialspace=True))
    columns = _columns(rows[1], rows[3:])
    return {
        name: {
            "speed [rad/s]": columns["Output Speed"],
            "iq [A]": columns["Test motor q-axis current"],
            "id [A]": columns["Test motor d-axis current"],
            "torque [mN m]": columns["Output Torque"],
            "bus_voltage [V]": columns["Input voltage"],
            "power [W]": columns["Input voltage"] * columns["Test motor Ibus"],
            "temperature [degC]": columns["Test Motor Temperature"],
        }
    }


def hej90_tables(text: str, name: str) -> Tables:
    """A joint's log: the last row of each hold, where the torque, a row behind the others, has arrived."""
    rows = list(csv.reader(text.splitlines()))
    columns = _columns(rows[0], rows[1:])
    updates = np.flatnonzero(np.diff(columns["i"])) + 1
    if len(updates) == 0:
        raise SprintlabError(f"{name}: the current never changes")
    phase = int(np.argmax(np.bincount(updates % HOLD, minlength=HOLD)))
    last = slice((phase - 1) % HOLD, None, HOLD)
    return {
        name: {
            "time [s]": columns["t"][last],
            "iq [A]": columns["i"][last],
            "speed [rad/s]": columns["velAct"][last],
            "torque [N m]": columns["torAct"][last],
        }
    }


def ak_tables(text: str, name: str) -> Tables:
    """A heating run, a second a row; the currents stand in the source's code (``ak_currents``)."""
    rows = list(csv.reader(text.lstrip("\ufeff").replace('"\t', '"').splitlines()))
    columns = _columns(rows[0], rows[1:])
    return {name: {"time [s]": columns["time"], "temperature [degC]": columns["temperature"]}}


def ak_profiles(code: str) -> Tables:
    """Steps of current and the surroundings of every run, read out of the source's code, which is not run.

    Returns:
        ``{run}-current``: until which second [s], how much [A]; and ``surroundings`` of the runs [degC].
    """
    tree = ast.parse(code)
    profiles = {
        node.name: _steps(node)
        for node in tree.body
        if isinstance(node, ast.ClassDef) and node.name.endswith("Profile")
    }
    tables: Tables = {}
    for node in tree.body:
        if not (isinstance(node, ast.Assign) and isinstance(node.value, ast.Call)):
            continue
        given = {word.arg: word.value for word in node.value.keywords}
        if "currentScript" not in given:
            continue
        run = Path(str(ast.literal_eval(given["filepath"]))).stem
        script = given["currentScript"]
        assert isinstance(script, ast.Call) and isinstance(script.func, ast.Name)
        until, current = np.array(profiles[script.func.id], dtype=float).T
        tables[f"{run}-current"] = {
            "until [s]": until,
            "current [A]": current,
            "ambient [degC]": np.full(len(until), float(ast.literal_eval(given["ambientTemperature"]))),
        }
    return tables


def _steps(profile: ast.ClassDef) -> list[tuple[float, float]]:
    """``(until, current)`` of ``if time < until: return current``, in the order of the code."""
    found: list[tuple[float, float]] = []
    for node in ast.walk(profile):
        if not isinstance(node, ast.If):
            continue
        comparisons = [part for part in ast.walk(node.test) if isinstance(part, ast.Compare)]
        limit = next(part.comparators[0] for part in comparisons if isinstance(part.ops[0], ast.Lt))
        answer = node.body[0]
        assert isinstance(answer, ast.Return) and answer.value is not None
        found.append((float(ast.literal_eval(limit)), float(ast.literal_eval(answer.value))))
    return [*sorted(found), (1e9, 0.0)]


def _columns(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> Table:
    """Numbers of the rows that are whole, by heading; a header may end with a comma."""
    headings = [heading for heading in headings if heading.strip()]
    whole = [row for row in rows if len(row) == len(headings)]
    try:
        numbers = np.array([[float(cell) for cell in row] for row in whole])
    except ValueError as error:
        raise SprintlabError(f"a cell is no number: {error}") from error
    if len(whole) == 0:
        raise SprintlabError("there is no row of numbers")
    return {heading.strip(): numbers[:, index] for index, heading in enumerate(headings)}


def _ak_convert(text: str, name: str) -> Tables:
    return ak_profiles(text) if name == "profiles" else ak_tables(text, name)


def _hej(stem: str) -> str:
    return f"{stem}_exp.csv"


def _futek(stamp: str) -> str:
    return f"futek_test_{stamp}.csv"


_STEPS = "Nm35,70,105,140_0.2,0.2,0.15,0.1_1.0,1.5,1.5,1.5_0.09,0.09,0.09,0.09"
SOURCES = {
    "ri50": Source(
        repository="karthikurs/actuator-dynamometer",
        commit="1ab6e56f6f9dbedd90398ccdfc05a4728ed38e03",
        terms="no licence: derived numbers only",
        folder="futek_data",
        files={
            "stall-april": _futek("27_04_2021_16-59-45"),
            "damping-april": _futek("27_04_2021_16-28-22"),
            "stall-13-may": _futek("13_05_2021_18-10-31"),
        },
        convert=ri50_tables,
    ),
    "d5065": Source(
        repository="Capo01/odrive_based_electric_motor_dynamometer",
        commit="6dd779a2e6fa051afdd1029ffeb238182de755a8",
        terms="GPL-3.0: not copied into this project",
        folder="Odrive motor testing procedure/Motor Data/Odrive D5065 270kv",
        files={"points": "odrive_data.csv"},
        convert=d5065_tables,
    ),
    "hej90": Source(
        repository="mmaag01/Actuator-Net",
        commit="07b1c87367dc0e1ec8c997cf8749f150f2d6c4d6",
        terms="no licence: derived numbers only; the data left the repository later",
        folder="Data/Main",
        files={
            "steps": _hej(_STEPS),
            "steps-140": _hej("Nm140_0.1_1.5_0.09"),
            "torque-sines-25-hz": _hej("TMS42_0.5-25_45Max"),
            "position-sines-10-hz": _hej("PMS42_0.1-10_maxlim"),
        },
        convert=hej90_tables,
    ),
    "ak": Source(
        repository="yunomi-git/Tmotor-Temperature-Analysis",
        commit="e9a91ab1c33e2c5115951156614928def8d6c62a",
        terms="no licence: derived numbers only",
        folder="",
        files={
            "profiles": "parameters/TemperatureDataset.py",
            "ak109Run1Data": "data/ak109Run1Data.csv",
            "ak109Run2Data": "data/ak109Run2Data.csv",
            "ak109Run3Data": "data/ak109Run3Data.csv",
            "ak109Run4Data": "data/ak109Run4Data.csv",
            "ak606Run1Data": "data/ak606Run1Data.csv",
            "ak606Run2Data": "data/ak606Run2Data.csv",
        },
        convert=_ak_convert,
    ),
}


def read_member(source: Source, clone: Path, name: str) -> str:
    """Text of one file of a source, from a git clone at its commit.

    Raises:
        SprintlabError: the place is not a clone that holds the commit.
    """
    path = f"{source.folder}/{name}" if source.folder else name
    shown = ["git", "-C", str(clone), "cat-file", "blob", f"{source.commit}:{path}"]
    run = subprocess.run(shown, capture_output=True, check=False)
    if run.returncode != 0:
        raise SprintlabError(
            f"{clone} does not have {path}: clone github.com/{source.repository}, which holds commit "
            f"{source.commit[:7]}, and give its folder"
        )
    return run.stdout.decode("utf-8", errors="replace")


def table_text(source: Source, file: str, table: Table) -> str:
    """A bench file: a remark on its origin, headings with units, numbers."""
    remark = f"# {source.repository}@{source.commit[:7]} {file}; {source.terms}"
    out = io.StringIO()
    rows = csv.writer(out, lineterminator="\n")
    rows.writerow(table)
    rows.writerows([f"{number:.9g}" for number in row] for row in zip(*table.values(), strict=True))
    return f"{remark}\n{out.getvalue()}"


def converted(key: str, place: Path) -> Iterator[tuple[str, str]]:
    """Name and text of every bench file that a source gives."""
    source = SOURCES[key]
    for name, file in source.files.items():
        for table_name, table in source.convert(read_member(source, place, file), name).items():
            yield f"{key}-{table_name}.csv", table_text(source, file, table)


def main(arguments: Sequence[str] | None = None) -> int:
    """Convert one source; a refusal is one sentence on stderr and status 2."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("source", choices=tuple(SOURCES))
    parser.add_argument("place", type=Path, help="a git clone")
    parser.add_argument("--output", type=Path, default=Path("bench-data"), help="folder of the bench files")
    chosen = parser.parse_args(arguments)
    try:
        chosen.output.mkdir(parents=True, exist_ok=True)
        count = 0
        for name, text in converted(chosen.source, chosen.place):
            atomic_write_text(chosen.output / name, text)
            count += 1
    except (SprintlabError, OSError) as error:
        print(f"fetch_bench_data: {error}", file=sys.stderr)
        return REFUSED
    print(f"{count} bench files in {chosen.output}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
