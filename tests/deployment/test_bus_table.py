"""The documentation shows the table that was measured."""

import importlib.util
import json
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
RESULT = ROOT / "results" / "deployment" / "bus_tolerance.json"


def benchmark():
    spec = importlib.util.spec_from_file_location("bus_tolerance", ROOT / "benchmarks" / "bus_tolerance.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


def test_the_page_shows_the_committed_table():
    table = benchmark().markdown(json.loads(RESULT.read_text())["rows"])
    assert table.strip() in (ROOT / "docs" / "robot-bus.md").read_text(encoding="utf-8")


def test_the_committed_table_has_every_condition_of_the_benchmark():
    rows = json.loads(RESULT.read_text())["rows"]
    conditions = {(row["delay_ms"], row["jitter_ms"], row["loss_percent"]) for row in rows}
    wanted = {(c.delay_ms, c.jitter_ms, c.loss_percent) for c in benchmark().CONDITIONS}
    assert conditions == wanted
    assert all(row["runs"] >= 3 for row in rows)
