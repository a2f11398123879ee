"""Motor benches measured by others, as bench files of ours: ``python tools/fetch_bench_data.py ri50 CLONE``.

None of these data may be copied into this project (three sources have no licence, one is GPL), so nothing is
downloaded and nothing is committed: clone a source yourself and give its path. Files are read at the commit
that our results name, whatever is checked out; each must have the SHA-256 that stands here. They are
converted into ``--output``, on which ``python -m studies.benches`` works.
"""

from __future__ import annotations

import argparse
import ast
import csv
import hashlib
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
        commit: at which the files have their hashes.
        terms: what its licence allows.
        folder: of the files inside the repository.
        files: our name of each table, by the file's name and SHA-256.
        convert: a file's text and our name of it -> tables by name.
    """

    repository: str
    commit: str
    terms: str
    folder: str
    files: dict[str, tuple[str, str]]
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
            "stall-april": (
                _futek("27_04_2021_16-59-45"),
                "1babdf3c6e6cc1873e22bd86fd963032e1843f39139a92052c9f14d3858a4d97",
            ),
            "damping-april": (
                _futek("27_04_2021_16-28-22"),
                "8246bbf8e63d0a99d12c44d737e5b612d6f0d32a278438d08427d8c425823b7e",
            ),
            "stall-12-may": (
                _futek("12_05_2021_11-32-30"),
                "f6cdd4c8ef12b08cb108a011fab24bc6f50ba81f873b6c4dcd61bae06fbf2bac",
            ),
            "stall-13-may": (
                _futek("13_05_2021_18-10-31"),
                "d5c31cba507acf9e845563af09bb62c9dc2d6683b7140a7616a0470fa5942845",
            ),
            "stall-24-may": (
                _futek("24_05_2021_16-20-14"),
                "0ad0e97f8e762f766768d07f367c6d99fa94c8648ea979872738ce9ab4ba2c62",
            ),
        },
        convert=ri50_tables,
    ),
    "d5065": Source(
        repository="Capo01/odrive_based_electric_motor_dynamometer",
        commit="6dd779a2e6fa051afdd1029ffeb238182de755a8",
        terms="GPL-3.0: not copied into this project",
        folder="Odrive motor testing procedure/Motor Data/Odrive D5065 270kv",
        files={
            "points": (
                "odrive_data.csv",
                "0e755960394d24e3d17ddb7a3c4caa41a4bd1da2d6cdb197c08c1d246dbb5532",
            )
        },
        convert=d5065_tables,
    ),
    "hej90": Source(
        repository="mmaag01/Actuator-Net",
        commit="07b1c87367dc0e1ec8c997cf8749f150f2d6c4d6",
        terms="no licence: derived numbers only; the data left the repository later",
        folder="Data/Main",
        files={
            "steps": (_hej(_STEPS), "0eac0cca106b5e7ffaa15852ca078c9fa6d558d6aece955bdafd4ce79736432d"),
            "steps-35": (
                _hej("Nm35_0.2_1.0_0.09"),
                "3de777e27c04a897d2eb7282355c4ffb37b0ec6b8856130167be7d80744ec704",
            ),
            "steps-70": (
                _hej("Nm70_0.2_1.5_0.09"),
                "c27295a12f95f99c79182b88af3fcaac226668a777e85fd40108f0f9423b4178",
            ),
            "steps-105": (
                _hej("Nm105_0.15_1.5_0.09"),
                "6758b2ef036f7e345e0a2c4d996cf4c66c706e47ffd5367ef15fc5e0857b94b8",
            ),
            "steps-140": (
                _hej("Nm140_0.1_1.5_0.09"),
                "a023e2cdf7640fa989c1dcfb0f9dd92ec7c1419c11a73966a72b9e29f78fce8e",
            ),
            "torque-sines-5-hz": (
                _hej("TMS42_0.5-5_70"),
                "f53bee7bf14ff7d52df335d0ea099099720284a366c1b8662441976a409c1d24",
            ),
            "torque-sines-25-hz": (
                _hej("TMS42_0.5-25_45Max"),
                "aac5db3f0e073fae4b2b3565943cb8981a85f5406dcd43008a9f74f413ef2e14",
            ),
            "position-sines-10-hz": (
                _hej("PMS42_0.1-10_maxlim"),
                "ace3112d9bbba8e900d1bd99eeb3235285c3d331dba8224d9dd325d19106ff44",
            ),
            "position-sines-10-hz-again": (
                _hej("PMS6769_0.10-10_maxlim"),
                "409c4811f52c965e4bbc0239b1aab46fec96850864bdc544a2d982d0a7a60bbd",
            ),
            "position-sines-25-hz": (
                _hej("PMS42_0.25-25_1.4xlim"),
                "9f47de8f45bf60e79e20a83cdb55444432596dc3349cbf803a58dc7697b3eefb",
            ),
            "chirp-10-hz": (
                _hej("PLC_0.10-10"),
                "da296cb60ff7fa43a2ae02cdd7d0b3f54ca909e5b2a6ae942531fff03b4d929f",
            ),
            "chirp-25-hz": (
                _hej("PLC_0.25-25"),
                "e69939f73fb526f043ed9c194f3f61b73cd4dde1093ef484165f01553f5cdffc",
            ),
        },
        convert=hej90_tables,
    ),
    "ak": Source(
        repository="yunomi-git/Tmotor-Temperature-Analysis",
        commit="e9a91ab1c33e2c5115951156614928def8d6c62a",
        terms="no licence: derived numbers only",
        folder="",
        files={
            "profiles": (
                "parameters/TemperatureDataset.py",
                "a5548d03f7d40253bbed2d7eb8560bf8fd3033a30f9330d68c0a8c14c871f4c4",
            ),
            "ak109Run1Data": (
                "data/ak109Run1Data.csv",
                "7ae40e92c7c5955bf673e40bb6754aac1bbd29f410deb6e31127d479d0541746",
            ),
            "ak109Run2Data": (
                "data/ak109Run2Data.csv",
                "990c5d0f41f9d88ee8c981b65433c04f6f02f5fdb976190debdb6702f46f9f97",
            ),
            "ak109Run3Data": (
                "data/ak109Run3Data.csv",
                "5737b7e07786f960d610d0a78c7d1614b0f1366e53bd71ef3397380cdd2cc950",
            ),
            "ak109Run4Data": (
                "data/ak109Run4Data.csv",
                "71befcd3f8e3e2bb9cef2c3c48d94794a84196d049278bd97ff68e1e9edf83f9",
            ),
            "ak606Run1Data": (
                "data/ak606Run1Data.csv",
                "7de09c441f50e3b2b84d71f31888794a249502608c4e08735413ed5a9a03336e",
            ),
            "ak606Run2Data": (
                "data/ak606Run2Data.csv",
                "fcbba5b046c99422dffca81a09125cd1d4a8eb3e08b25b4e7dd1065bea997d29",
            ),
            "ak809Run1Data": (
                "data/ak809Run1Data.csv",
                "b161acdc601cb93bef10d9d7a4ba157b3dd629079b1b5eab7987ab038dcaa09d",
            ),
        },
        convert=_ak_convert,
    ),
}


def read_member(source: Source, place: Path, name: str) -> bytes:
    """One file of a source, from a git clone at its commit, or from a plain folder.

    Raises:
        SprintlabError: the place is not a folder or does not have the file.
    """
    path = f"{source.folder}/{name}" if source.folder else name
    shown = ["git", "-C", str(place), "cat-file", "blob", f"{source.commit}:{path}"]
    run = subprocess.run(shown, capture_output=True, check=False) if place.is_dir() else None
    if run is not None and run.returncode == 0:
        return run.stdout
    if (place / path).is_file():
        return (place / path).read_bytes()
    raise SprintlabError(
        f"{place} does not have {path}: clone github.com/{source.repository}, which holds commit "
        f"{source.commit[:7]}, and give its folder"
    )


def checked_text(source: Source, name: str, content: bytes) -> str:
    """The file's text; raises ``SprintlabError`` if it is not the file that our results are of."""
    file, expected = source.files[name]
    found = hashlib.sha256(content).hexdigest()
    if found != expected:
        raise SprintlabError(
            f"{file} has SHA-256 {found[:12]}..., the results are of {expected[:12]}...: take it from commit "
            f"{source.commit[:7]} of {source.repository}"
        )
    return content.decode("utf-8", errors="replace")


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
    for name, (file, _) in source.files.items():
        text = checked_text(source, name, read_member(source, place, file))
        for table_name, table in source.convert(text, name).items():
            yield f"{key}-{table_name}.csv", table_text(source, file, table)


def main(arguments: Sequence[str] | None = None) -> int:
    """Convert one source; a refusal is one sentence on stderr and status 2."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("source", choices=tuple(SOURCES))
    parser.add_argument("place", type=Path, help="a git clone, or a folder of its files")
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
