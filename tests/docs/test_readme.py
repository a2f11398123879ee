"""The README is one screen, and its numbers are those of the committed results."""

import re
from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_it_is_short_and_every_link_leads_somewhere():
    assert len(README.splitlines()) < 120
    for target in re.findall(r"\]\((?!https?:)([^)#]+)", README):
        assert (ROOT / target).exists(), target


def test_its_picture_moves_and_is_small():
    picture = (ROOT / "docs" / "images" / "sprint.webp").read_bytes()
    assert picture[:4] == b"RIFF" and b"ANIM" in picture[:64] and len(picture) < 1_500_000


def test_our_rows_are_the_committed_numbers(load_script):
    tables = load_script("tools/result_tables.py")
    assert tables.readme_rows() in README
    assert tables.readme_with_rows(README) == README, "run python tools/result_tables.py"


def test_the_paper_can_be_cited():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    (paper,) = citation["references"]
    assert paper["title"] in " ".join(README.split()) and str(paper["year"]) in README
    assert all(author["family-names"] in README for author in paper["authors"])
    assert paper["journal"] in README
