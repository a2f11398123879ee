"""The README is one screen, and its numbers are those of the committed results."""

import json
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


def test_the_table_holds_the_committed_speeds():
    first = json.loads((ROOT / "results" / "bp2-sprint" / "result.json").read_text())
    assert f"| MuJoCo | {first['held_speed_m_s']:.2f} m/s | {first['time_100m_s']:.2f} s |" in README
    compared = json.loads((ROOT / "results" / "second_engine" / "speeds.json").read_text())["policies"]
    sprint = next(entry for entry in compared.values() if entry["policy"] == "sprint")
    for engine in ("mujoco", "drake"):
        numbers = sprint[engine]
        assert f"{numbers['falls']} of {numbers['trials']}" in README
        assert f"| {numbers['held_speed_m_s']:.2f} m/s | {numbers['sprint_time_s']:.2f} s |" in README


def test_the_paper_can_be_cited():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    (paper,) = citation["references"]
    assert paper["title"] in " ".join(README.split()) and str(paper["year"]) in README
    assert all(author["family-names"] in README for author in paper["authors"])
    assert paper["journal"] in README
