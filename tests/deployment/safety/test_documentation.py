"""The page that users read says what the controller does, and which test shows it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from tests.deployment.safety import test_fault_matrix as matrix

from sprintlab.deployment.safety import RESPONSES, Fault

ROOT = Path(__file__).parents[3]
PAGE = ROOT / "docs" / "safety.md"
OTHER_TESTS = {
    Fault.STAND_FAILED: "a stand-up that fails (`test_modes.py`)",
    Fault.BRAKE_FAILED: "a brake that takes too long (`test_modes.py`)",
}


def table() -> str:
    """Every response, and the faults that the matrix throws for it."""
    lines = ["| fault | what it is | reaction | within | thrown in the tests |", "|---|---|---|---|---|"]
    for fault, response in RESPONSES.items():
        thrown = [
            name
            for faults in (matrix.DROPPED, matrix.STOPPED, matrix.BRAKED)
            for name, (found, _) in faults.items()
            if found is fault
        ]
        tests = "; ".join(thrown) or OTHER_TESTS[fault]
        within = f"{1e3 * response.within:g} ms"
        lines.append(
            f"| `{fault.value}` | {response.meaning} | {response.reaction.value} | {within} | {tests} |"
        )
    return "\n".join(lines)


@pytest.fixture(scope="module")
def page() -> str:
    if not PAGE.is_file():
        pytest.skip("the documents are not part of an installed package")
    return PAGE.read_text(encoding="utf-8")


def test_the_page_lists_every_response_as_it_is(page):
    assert table() in page


def test_the_page_counts_the_faults_of_the_matrix(page):
    assert f"{matrix.FAULTS_TRIED} faults" in page


def test_every_test_that_the_page_names_exists(page):
    named = re.findall(r"`(test_\w+\.py)`(?:,\s`(test_\w+)`)?", page)
    assert len(named) >= 10
    files = {path.name: path.read_text(encoding="utf-8") for path in (ROOT / "tests").rglob("test_*.py")}
    for file, function in named:
        assert file in files
        assert not function or f"def {function}(" in files[file], f"{file} has no {function}"
