"""The page that users read says what the controller does."""

from pathlib import Path

import pytest
from tests.deployment.guard import test_fault_matrix as matrix

from sprintlab.deployment.guard import Fault

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def page() -> str:
    return (ROOT / "docs" / "deployment.md").read_text(encoding="utf-8")


def test_the_page_lists_every_response_as_it_is(page):
    lines = ["| fault | what it is | reaction | within |", "|---|---|---|---|"]
    for fault in Fault:
        within = f"{1e3 * fault.within:g} ms"
        lines.append(f"| `{fault.value}` | {fault.meaning} | {fault.reaction.value} | {within} |")
    assert "\n".join(lines) in page
    assert f"{sum(map(len, (matrix.DROPPED, matrix.STOPPED, matrix.BRAKED)))} faults" in page
