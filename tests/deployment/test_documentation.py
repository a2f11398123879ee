"""The page that users read says what the controller does."""

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
