"""The numbers of policies in the pages are those of the committed races and searches of the shipped files."""

import hashlib
import json
from pathlib import Path
from typing import NamedTuple

import pytest

from sprintlab.control import shipped_policy

ROOT = Path(__file__).resolve().parents[2]
WAYS = {"raw": "raw", "self_paced": "self-paced"}
SHORT = {"stride period from policy clock": "clock", "highest joint speed over no-load speed": "joint speed"}


class Told(NamedTuple):
    """A policy that the results page tells of in a section of its own.

    Attributes:
        policy: its name.
        section: the section's heading.
        robot: that it drives.
        command: of its race [m/s].
        audit: what the race fails.
    """

    policy: str
    section: str
    robot: str
    command: int
    audit: frozenset[str] = frozenset()

    def committed(self, name):
        file = ROOT / "results" / self.policy / f"{name}.json"
        return json.loads(file.read_text(encoding="utf-8"))

    def cells(self, label):
        """The row of the section that begins with ``label``, without it."""
        page = (ROOT / "docs" / "results.md").read_text(encoding="utf-8")
        section = page.split(f"\n## {self.section}\n")[1].split("\n## ")[0]
        start = f"| {label.format(command=self.command)} "
        row = next(line for line in section.splitlines() if line.replace("**", "").startswith(start))
        return [cell.replace("**", "").strip() for cell in row.strip("|").split("|")[1:]]


GO1 = Told("go1-sprint", "A second robot: Go1", "go1", 8)
FAST = Told(
    "sprint-fast",
    "Fast and sure: `sprint-fast`",
    "bp2",
    14,
    frozenset({"stride period from policy clock"}),
)
both = pytest.mark.parametrize("told", [GO1, FAST], ids=lambda told: told.policy)


@both
def test_the_race_was_run_by_the_policy_that_is_shipped(told):
    race = told.committed("result")
    shipped = hashlib.sha256(shipped_policy(told.policy).read_bytes()).hexdigest()
    assert race["facts"]["policy SHA-256"] == shipped
    assert race["robot"] == told.robot and race["falls"] == 0
    assert {item["name"] for item in race["audit"]["items"] if not item["passed"]} == told.audit


@pytest.mark.parametrize(
    ("label", "key", "form"),
    [
        ("J at {command} m/s [rad²/s]", "J_rad2_s", ".2f"),
        ("cost of transport at {command} m/s", "cost_of_transport", ".2f"),
        ("sideways deviation at {command} m/s [m]", "lateral_deviation_m", ".1f"),
        ("stride frequency at {command} m/s [Hz]", "stride_frequency_Hz", ".2f"),
    ],
)
@both
def test_the_table_is_of_the_race(told, label, key, form):
    race = told.committed("result")
    assert told.cells(label) == [format(numbers[key], form) for numbers in (race, race["self_paced"])]


def test_the_fast_policy_s_numbers_stand_in_every_page(flowing):
    race, clock = FAST.committed("result"), FAST.committed("clock")["clock_check"]
    assert FAST.cells("100 m at 14 m/s [s]") == [
        f"{race[key]:.2f}" for key in ("time_100m_s", "time_100m_self_paced_s")
    ]
    held = f"{race['held_speed_m_s']:.2f} m/s"
    assert f"holds {held} and runs 100 m in {race['time_100m_s']:.2f} s" in flowing("README.md")
    assert held in flowing("docs/speed-limit.md")
    assert all(clock["completed"] == clock["trials"] for clock in clock["clocks"])
    for page in ("README.md", "docs/results.md"):
        assert f"{100 * clock['greatest_loss_of_speed']:.1f} %" in flowing(page)
    searched = FAST.committed("search")
    assert all(row["falls"] == 0 for way in WAYS for row in searched[way]["speeds"])


def test_times_and_speeds_stand_in_every_page(flowing):
    race, cells = GO1.committed("result"), GO1.cells
    times = [f"{race[key]:.2f}" for key in ("time_100m_s", "time_100m_self_paced_s")]
    assert cells("100 m at 8 m/s [s]") == times
    assert f"{times[0]} s and {times[1]} s" in flowing("docs/tutorial-robot.md")
    held = f"{race['held_speed_m_s']:.2f} m/s"
    assert f"runs 100 m in {times[0]} s and holds {held}" in flowing("README.md")
    assert held in flowing("docs/speed-limit.md")
    assert f"{held} and {race['self_paced']['held_speed_m_s']:.2f} m/s" in flowing("docs/tutorial-robot.md")


@both
@pytest.mark.parametrize("way", WAYS)
def test_the_search_is_told_as_it_was(told, way):
    search, column, cells = told.committed("search")[way], list(WAYS).index(way), told.cells
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
            if way == "raw" or told is GO1:
                assert marks[command] == (", ".join(SHORT[item] for item in row["audit_failed"]) or "passed")
    assert cells("max velocity: held there [m/s]")[column].startswith(
        f"{search['max_velocity_m_s']:.2f}, audit"
    )
    for label, key in (("most that was held [m/s]", ""), ("most that was held with", "_with_audit_passed")):
        most = search[f"fastest{key}"]
        text = f"{most['held_speed_m_s']:.2f} at {most['top_speed_m_s']:g}"
        assert cells(label)[column].startswith(text)
