"""The documentation shows the table that was measured."""

import json
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
RESULT = ROOT / "results" / "deployment" / "bus_tolerance.json"


@pytest.fixture(scope="module")
def benchmark_module(load_script):
    return load_script("benchmarks/bus_tolerance.py")


def test_the_page_shows_the_committed_table(benchmark_module):
    table = benchmark_module.markdown(json.loads(RESULT.read_text())["rows"])
    assert table.strip() in (ROOT / "docs" / "deployment.md").read_text(encoding="utf-8")


def test_the_committed_table_has_every_condition_of_the_benchmark(benchmark_module):
    rows = json.loads(RESULT.read_text())["rows"]
    conditions = {(row["delay_ms"], row["jitter_ms"], row["loss_percent"]) for row in rows}
    wanted = {(c.delay_ms, c.jitter_ms, c.loss_percent) for c in benchmark_module.CONDITIONS}
    assert conditions == wanted
    assert all(row["runs"] >= 3 for row in rows)
