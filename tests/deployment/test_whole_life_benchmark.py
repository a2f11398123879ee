"""The benchmark of whole lives counts as it says, and the page says what it counted."""

import json
from pathlib import Path

import pytest

from sprintlab.core.errors import SprintlabError

ROOT = Path(__file__).resolve().parents[2]
RESULT = ROOT / "results" / "deployment" / "whole_life.json"


@pytest.fixture(scope="module")
def benchmark_module(load_script):
    return load_script("benchmarks/whole_life.py")


def test_a_life_that_ends_early_counts_and_says_how(benchmark_module):
    ends = [("", 3.0, 0.2), ("run: knee contact", 40.0, 0.1), ("run: knee contact", 2.0, 0.5)]
    row = benchmark_module.summary("sprint", 2.0, ends)
    assert (row["lives"], row["lived"], row["failures"]) == (3, 1, ["run: knee contact"])
    assert (row["greatest_tilt_deg"], row["greatest_sinking_m_s"]) == (40.0, 0.5)


@pytest.mark.parametrize(
    ("arguments", "named"),
    [(["--policies", "gallop"], "gallop"), (["--speeds", "0"], "speeds"), (["--seeds", "0"], "seeds")],
)
def test_what_it_cannot_measure_is_refused(benchmark_module, arguments, named):
    with pytest.raises(SprintlabError, match=named):
        benchmark_module.parse(arguments)


def test_the_page_tells_what_was_counted(flowing):
    rows = json.loads(RESULT.read_text(encoding="utf-8"))["rows"]
    page = flowing("docs/deployment.md")
    for policy in {row["policy"] for row in rows}:
        of_policy = [row for row in rows if row["policy"] == policy]
        lived, lives = (sum(row[name] for row in of_policy) for name in ("lived", "lives"))
        assert f"`{policy}` {lived} of {lives}" in page
