"""The page that users read says what the controller does, and shows the table that was measured."""

import json
from pathlib import Path

import pytest
from tests.deployment.safety import test_fault_matrix as matrix

from sprintlab.deployment.safety import RESPONSES

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def page() -> str:
    return (ROOT / "docs" / "deployment.md").read_text(encoding="utf-8")


def test_the_page_lists_every_response_as_it_is(page):
    lines = ["| fault | what it is | reaction | within |", "|---|---|---|---|"]
    for fault, response in RESPONSES.items():
        within = f"{1e3 * response.within:g} ms"
        lines.append(f"| `{fault.value}` | {response.meaning} | {response.reaction.value} | {within} |")
    assert "\n".join(lines) in page
    assert f"{sum(map(len, (matrix.DROPPED, matrix.STOPPED, matrix.BRAKED)))} faults" in page


def test_the_page_shows_the_measured_table(page, load_script):
    benchmark = load_script("benchmarks/bus_tolerance.py")
    rows = json.loads((ROOT / "results" / "deployment" / "bus_tolerance.json").read_text())["rows"]
    assert benchmark.markdown(rows).strip() in page
    conditions = {(row["delay_ms"], row["jitter_ms"], row["loss_percent"]) for row in rows}
    assert conditions == {(c.delay_ms, c.jitter_ms, c.loss_percent) for c in benchmark.CONDITIONS}
    assert all(row["runs"] >= 3 for row in rows)
