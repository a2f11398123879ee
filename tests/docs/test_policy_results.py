"""The numbers of the Go1 policy in the pages are those of the committed race and search of its file."""

import hashlib
import json
from pathlib import Path

import pytest

from sprintlab.control import shipped_policy

ROOT = Path(__file__).resolve().parents[2]
POLICY = "go1-sprint"
WAYS = {"raw": "raw", "self_paced": "self-paced"}
SHORT = {"stride period from policy clock": "clock", "highest joint speed over no-load speed": "joint speed"}


def committed(name):
    return json.loads((ROOT / "results" / POLICY / f"{name}.json").read_text(encoding="utf-8"))


def cells(label):
    """The row of the policy's section of the results page that begins with ``label``, without it."""
    page = (ROOT / "docs" / "results.md").read_text(encoding="utf-8")
    section = page.split("\n## A second robot: Go1\n")[1].split("\n## ")[0]
    row = next(line for line in section.splitlines() if line.replace("**", "").startswith(f"| {label} "))
    return [cell.replace("**", "").strip() for cell in row.strip("|").split("|")[1:]]


def test_the_race_was_run_by_the_policy_that_is_shipped():
    race = committed("result")
    assert race["facts"]["policy SHA-256"] == hashlib.sha256(shipped_policy(POLICY).read_bytes()).hexdigest()
    assert race["robot"] == "go1" and race["falls"] == 0
    assert race["audit"]["passed"]


@pytest.mark.parametrize(
    ("label", "key", "form"),
    [
        ("J at 8 m/s [rad²/s]", "J_rad2_s", ".2f"),
        ("cost of transport at 8 m/s", "cost_of_transport", ".2f"),
        ("sideways deviation at 8 m/s [m]", "lateral_deviation_m", ".1f"),
        ("stride frequency at 8 m/s [Hz]", "stride_frequency_Hz", ".2f"),
    ],
)
def test_the_table_is_of_the_race(label, key, form):
    race = committed("result")
    assert cells(label) == [format(numbers[key], form) for numbers in (race, race["self_paced"])]


def test_times_and_speeds_stand_in_every_page(flowing):
    race = committed("result")
    times = [f"{race[key]:.2f}" for key in ("time_100m_s", "time_100m_self_paced_s")]
    assert cells("100 m at 8 m/s [s]") == times
    assert f"{times[0]} s and {times[1]} s" in flowing("docs/tutorial-robot.md")
    held = f"{race['held_speed_m_s']:.2f} m/s"
    assert f"runs 100 m in {times[0]} s and holds {held}" in flowing("README.md")
    assert held in flowing("docs/speed-limit.md")
    assert f"{held} and {race['self_paced']['held_speed_m_s']:.2f} m/s" in flowing("docs/tutorial-robot.md")


@pytest.mark.parametrize("way", WAYS)
def test_the_search_is_told_as_it_was(way):
    search, column = committed("search")[way], list(WAYS).index(way)
    speeds = {row["top_speed_m_s"]: row for row in search["speeds"]}
    commands = [float(command) for command in cells("command [m/s]")]
    held = dict(zip(commands, cells(f"held, {WAYS[way]} [m/s]"), strict=True))
    marks = dict(zip(commands, cells("audit"), strict=True))
    for command in commands:
        row = speeds.get(command)
        if row is None or command > search["top_speed_command_m_s"]:
            assert held[command] == "not tried"
        else:
            assert held[command] == f"{row['held_speed_m_s']:.2f}"
            assert marks[command] == (", ".join(SHORT[item] for item in row["audit_failed"]) or "passed")
    assert cells("max velocity: held there [m/s]")[column].startswith(
        f"{search['max_velocity_m_s']:.2f}, audit"
    )
    for label, key in (("most that was held [m/s]", ""), ("most that was held with", "_with_audit_passed")):
        most = search[f"fastest{key}"]
        text = f"{most['held_speed_m_s']:.2f} at {most['top_speed_m_s']:g}"
        assert cells(label)[column].startswith(text)
