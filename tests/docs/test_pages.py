"""README and pages render on any forge, lead somewhere, and their tables hold the committed results."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
FENCE = re.compile(r"^ *```.*?^ *```", re.MULTILINE | re.DOTALL)
MOST_NUMBERS = 8
"""In one paragraph or list item: more belong into a table."""
SITE_ONLY = re.compile(r'^\s*(!!!|\?\?\?|===|--8<--|\{\{)|\{ ?\.\w+ ?\}|markdown="', re.MULTILINE)
NUMBER = re.compile(r"(?<![\w.\-])[-−±]?\d+(?:[.,]\d+)*(?!\w)")


def read(page):
    return page.read_text(encoding="utf-8")


def paragraphs(page):
    """Running text, list items apart; without code, formulas, tables, headings, targets and comments."""
    text = FENCE.sub("", read(page))
    text = re.sub(
        r"\$\$.*?\$\$|\$[^$\n]+\$|`[^`]*`|<!--.*?-->|\]\([^)]*\)|<[^>]+>", "", text, flags=re.DOTALL
    )
    blocks = re.split(r"\n\s*\n|\n(?=\s*(?:[-*]|\d+\.) )", text)
    return [block for block in blocks if not re.match(r"\s*[|#]", block)]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_pages_are_plain_markdown_and_no_paragraph_is_a_table_in_disguise(page):
    assert not (found := SITE_ONLY.search(FENCE.sub("", read(page)))), found
    for block in paragraphs(page):
        numbers = NUMBER.findall(block)
        assert len(numbers) <= MOST_NUMBERS, f"{len(numbers)} numbers in: {block.strip()}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_links_lead_somewhere(page):
    for target in re.findall(r'(?:\]\(|src="|srcset=")(?!https?:)([^)"\s]+)', FENCE.sub("", read(page))):
        path, _, anchor = target.partition("#")
        linked = (page.parent / path) if path else page
        assert linked.exists(), f"{page.name}: {target}"
        if anchor:
            assert anchor in {slug(title) for title in headings(linked)}, f"{page.name}: {target}"


def headings(page):
    return re.findall(r"^#+ (.+)$", FENCE.sub("", read(page)), re.MULTILINE)


def slug(title):
    """The anchor that forges and the site give a heading."""
    return re.sub(r"\s", "-", re.sub(r"[^\w\s-]", "", title.lower()).strip())


def test_tables_hold_the_committed_results(load_script):
    tables = load_script("tools/result_tables.py")
    found = tables.tables()
    for page in PAGES:
        assert tables.with_tables(read(page), found) == read(page), f"{page.name}: run tools/result_tables.py"


def test_beside_a_limit_stand_the_policy_or_else_the_median_seed_and_the_fastest_that_passes(load_script):
    tables = load_script("tools/result_tables.py")
    items = [{"name": "foot force", "passed": False}]
    race = {"robot": "go1", "held_speed_m_s": 7.0, "audit": {"items": items}}
    speeds = ((5.0, 5.0), (6.0, 6.5), (7.0, None))
    seeds = [{"held_speed_m_s": held, "best_passed_m_s": best, "failed": []} for held, best in speeds]
    robots = tables.beside_limits({"go1-sprint": race}, {"go1-sprint": seeds, "a1": seeds})
    beside = {name: [row.get(key) for key in ("held", "passed", "fastest")] for name, row in robots.items()}
    assert beside["go1"] == [7.0, False, 6.5] and beside["a1"] == [6.0, True, 6.5]
    assert beside["go2"] == [None, None, None]
    assert tables.limits_figure(robots).startswith(b"\x89PNG")
