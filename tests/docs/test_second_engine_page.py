"""The page of the second engine says what was measured."""

import json
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

from sprintlab.evaluation.second_engine import LARGEST_LOSS, STORED

ROOT = Path(__file__).parents[2]
ROWS = json.loads((ROOT / "results" / "second_engine" / "speeds.json").read_text())["policies"]


@pytest.mark.parametrize("digest", ROWS)
def test_the_table_has_the_measured_speeds(digest: str, load_script: Callable[[str], ModuleType]) -> None:
    row = ROWS[digest]
    lines = load_script("tools/result_tables.py").tables()["second_engine"].splitlines()
    line = next(line for line in lines if line.startswith(f"| `{row['policy']}`"))
    cells = [cell.strip() for cell in line.split("|")]
    for engine in ("mujoco", "drake"):
        held = row[engine]["held_speed_m_s"]
        assert ("-" if held is None else f"{held:.2f} m/s") in cells
    assert (row["mark"] or "none") in cells


@pytest.mark.parametrize("digest", ROWS)
def test_who_loses_too_much_or_falls_is_marked(digest: str) -> None:
    row = ROWS[digest]
    first, second = row["mujoco"], row["drake"]
    change = row["speed_change"]
    fault = second["falls"] > first["falls"] or (change is not None and change < -LARGEST_LOSS)
    assert bool(row["mark"]) == fault


def test_the_package_carries_the_same_numbers() -> None:
    assert json.loads(STORED.read_text(encoding="utf-8")) == ROWS
