"""Links of README and pages lead somewhere, and their tables hold the committed results."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
FENCE = re.compile(r"^ *```.*?^ *```", re.MULTILINE | re.DOTALL)


def read(page):
    return page.read_text(encoding="utf-8")


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
