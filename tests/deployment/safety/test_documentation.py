"""The page that users read says what the controller does."""

from pathlib import Path

import pytest
from tests.deployment.safety import test_fault_matrix as matrix

from sprintlab.deployment.safety import RESPONSES

PAGE = Path(__file__).parents[3] / "docs" / "deployment.md"


@pytest.fixture(scope="module")
def page() -> str:
    if not PAGE.is_file():
        pytest.skip("the documents are not part of an installed package")
    return PAGE.read_text(encoding="utf-8")


def test_the_page_lists_every_response_as_it_is(page):
    lines = ["| fault | what it is | reaction | within |", "|---|---|---|---|"]
    for fault, response in RESPONSES.items():
        within = f"{1e3 * response.within:g} ms"
        lines.append(f"| `{fault.value}` | {response.meaning} | {response.reaction.value} | {within} |")
    assert "\n".join(lines) in page


def test_the_page_counts_the_faults_of_the_matrix(page):
    assert f"{sum(map(len, (matrix.DROPPED, matrix.STOPPED, matrix.BRAKED)))} faults" in page
