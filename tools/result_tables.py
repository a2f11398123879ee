"""Tables of the results, from the committed JSON: a policy's numbers stand in no page by hand.

    python tools/result_tables.py    # puts the present numbers into the README

The site asks for the others while it is built (``tools/docs_hooks.py``).
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from sprintlab.evaluation.report_text import audit_limit, audit_value, number
from sprintlab.evaluation.results import AuditItem

RESULTS = Path(__file__).resolve().parents[1] / "results"
DEFAULT_POLICY = "sprint"
README_ROWS = re.compile(r"(\| the paper, BP2, as reported \| treadmill[^\n]*\n).*?(\| Margolis)", re.DOTALL)
"""Our rows stand between the paper's last row and the first of its peers."""
Row = dict[str, Any]
WHY_NOT_THE_PAPERS = {
    "progress": "under ACS the command follows the robot: tracking pays no more at 12 m/s than at 8",
    "fine_speed_tracking": "the paper's kernel is flat below 0.3 m/s",
    "fine_yaw_tracking": "the same of the yaw rate",
    "action_rate": "these three grow with the swing speed and held the speed near 9.4 m/s",
    "smoothness": "",
    "joint_acceleration": "",
    "roll_pitch_rate": "a robot that runs pitches",
    "collision": "prevents crawling",
    "grounded": "draws the policy from a grounded run, a local optimum, into one with flight",
    "touchdown": "feet that are rammed into the ground sink deeper than a real surface allows",
    "over_speed": "beyond the no-load speed a drive can only brake",
    "leg_distance": "in training only feet collide; without it legs pass through each other",
    "electrical_power": "mechanical power misses the copper loss",
    "gear_torque": "shocks are free in a simulation",
    "foot_force": "",
    "hasty_touchdowns": "else a gait becomes a tap",
    "short_stances": "",
    "restlessness": "a robot that is asked to stand shall stand",
}
"""Why a reward term has another weight than the paper's; empty: for the reason above it."""


def tables() -> dict[str, str]:
    """Every table by the name under which a page asks for it: ``{{ name }}``."""
    races, engines = policy_results("result.json"), _second_engine()
    sprints = policy_results("robustness.json")
    return {
        "policy_summary": policy_summary(races, engines, sprints),
        "policy_audit": policy_audit(races),
        "robustness": robustness(sprints),
        "second_engine": second_engine(engines),
        "reward_departures": reward_departures(),
    }


def reward_departures() -> str:
    """Every reward term whose weight is not the paper's, by stage, and why."""
    from sprintlab.training.methods import paper_rewards
    from sprintlab.training.settings import RewardSettings

    paper, ours = vars(paper_rewards()), vars(RewardSettings())
    weights = {name for name, value in ours.items() if not isinstance(value, (bool, str))}
    changed = sorted(name for name in weights if paper[name] != ours[name])
    if set(changed) != set(WHY_NOT_THE_PAPERS):
        raise ValueError(f"reasons for {sorted(WHY_NOT_THE_PAPERS)}, but {changed} differ from the paper")
    rows = [
        (name.replace("_", " "), _weight(paper[name]), _weight(ours[name]), why)
        for name, why in WHY_NOT_THE_PAPERS.items()
    ]
    return _table(("term", "paper", "here", "why"), rows)


def _weight(value: Any) -> str:
    """A reward weight, or its two where the stages differ; a dash: the term is not there."""
    stages = (value, value) if isinstance(value, float) else (value.first, value.second)
    shown = stages[:1] if stages[0] == stages[1] else stages
    return ", then ".join(f"{each:g}" for each in shown) if any(stages) else "-"


def policy_results(file: str) -> dict[str, Row]:
    """What a command printed of each policy, ``results/POLICY/FILE``, the default policy first.

    ``result.json`` is that of ``sprintlab race``, ``robustness.json`` of ``sprintlab robustness --json``.
    """
    paths = sorted(RESULTS.glob(f"*/{file}"), key=lambda path: path.parent.name != DEFAULT_POLICY)
    return {path.parent.name: json.loads(path.read_text(encoding="utf-8")) for path in paths}


def policy_summary(races: dict[str, Row], engines: Sequence[Row], sprints: dict[str, Row]) -> str:
    """The first screen: speed, second engine, 100 m, upright, audit."""
    drake = {row["policy"]: row["drake"]["held_speed_m_s"] for row in engines}
    head = ("", "command", "held, MuJoCo", "held, Drake", "100 m", "upright", "audit")
    rows = []
    for name, race in races.items():
        command = f"{race['top_speed_command_m_s']:g} m/s"
        speeds = (held(race), _speed(drake.get(name)))
        rows.append(
            (f"`{name}`", command, *speeds, time(race), upright(sprints[name]), audit(race, "lines fail"))
        )
    return _table(head, rows)


def policy_audit(races: dict[str, Row]) -> str:
    """Every line of the audit, a column a policy; what fails is bold."""
    columns = list(races.values())
    lines: list[tuple[str, Callable[[Row], str]]] = [
        ("held, raw", held),
        ("held, self-paced", lambda row: held(row["self_paced"])),
        ("still rising by", lambda row: f"{_cell(row['hold_acceleration_m_s2'])} m/s²"),
        ("stride frequency", lambda row: f"{_cell(row['stride_frequency_Hz'], 1)} Hz"),
        ("duty factor", lambda row: _cell(row["duty"], 3)),
        ("cost of transport", lambda row: _cell(row["cost_of_transport"])),
    ]
    rows = [(label, *(text(row) for row in columns)) for label, text in lines]
    for items in zip(*(row["audit"]["items"] for row in columns), strict=True):
        rows.append((f"{items[0]['name']}: {audit_limit(AuditItem(**items[0]))}", *map(_audit_cell, items)))
    return _table(("", *(f"`{name}`" for name in races)), rows)


def robustness(sprints: dict[str, Row]) -> str:
    """Shares upright and quantiles of the held speed."""
    head = ("policy", "command", "upright (95 % interval)", "held: 5 / 50 / 95 % hold less")
    rows = []
    for name, row in sprints.items():
        found = row["held_speed_quantiles_m_s"]
        speeds = " / ".join(_cell(found[quantile], 1) for quantile in ("0.05", "0.5", "0.95"))
        rows.append((f"`{name}`", f"{row['top_speed_command_m_s']:g} m/s", upright(row), f"{speeds} m/s"))
    return _table(head, rows)


def second_engine(engines: Sequence[Row]) -> str:
    """Speeds, falls and times of both engines."""
    falls = "falls, MuJoCo / Drake"
    head = ("policy", "robot", "command", "MuJoCo", "Drake", "change", falls, "100 m", "mark")
    rows = []
    for row in engines:
        first, second = row["mujoco"], row["drake"]
        change = row["speed_change"]
        cells = (
            f"`{row['policy']}`",
            row["robot"],
            f"{row['top_speed_command_m_s']:g} m/s",
            _speed(first["held_speed_m_s"]),
            _speed(second["held_speed_m_s"]),
            "-" if change is None else f"{100 * change:+.1f} %",
            f"{first['falls']} / {second['falls']} of {first['trials']}",
            f"{_cell(first['sprint_time_s'])} / {_cell(second['sprint_time_s'])} s",
            row["mark"] or "none",
        )
        rows.append(cells)
    return _table(head, rows)


def readme_rows() -> str:
    """The rows of the default policy for the README's table, an engine each, between its two marks."""
    engines = next(row for row in _second_engine() if row["policy"] == DEFAULT_POLICY)
    race = policy_results("result.json")[DEFAULT_POLICY]
    rows = []
    for engine, label in (("mujoco", "MuJoCo"), ("drake", "Drake")):
        found = engines[engine]
        who = (
            f"ours, `{DEFAULT_POLICY}`: {audit(race, 'audit lines fail')}"
            if engine == "mujoco"
            else "the same policy file"
        )
        where = f"{label}, {found['falls']} of {found['trials']} trials fell"
        rows.append((who, where, _speed(found["held_speed_m_s"]), f"{_cell(found['sprint_time_s'])} s"))
    return "\n".join(f"| {' | '.join(cells)} |" for cells in rows)


def readme_with_rows(text: str) -> str:
    """The README with the committed numbers in its table."""
    return README_ROWS.sub(lambda match: match[1] + readme_rows() + "\n" + match[2], text)


def audit(race: Row, lines: str) -> str:
    """How many lines of the audit fail."""
    items = race["audit"]["items"]
    failed = sum(not item["passed"] for item in items)
    return f"**{failed} of {len(items)} {lines}**" if failed else "audit passed"


def time(race: Row) -> str:
    """Time over 100 m, with its mark."""
    if race["time_100m_s"] is None:
        return "not finished"
    return f"{number(race['time_100m_s'])} s" + (", left its lane" if race["left_lane"] else "")


def held(trials: Row) -> str:
    """What was held, and how many trials fell or did not stop."""
    faults = {"fell": trials["falls"], "did not stop": trials["not_stopped"]}
    marks = [f"{count} of {trials['trials']} {fault}" for fault, count in faults.items() if count]
    return ", ".join([_speed(trials["held_speed_m_s"]), *marks])


def upright(row: Row) -> str:
    """Sprints without a fall, with their interval."""
    lower, upper = (100 * bound for bound in row["interval_95"])
    return f"{row['upright']} of {row['trials']} ({lower:.0f} to {upper:.0f} %)"


def _second_engine() -> list[Row]:
    return list(_read("second_engine/speeds.json").values())


def _read(name: str) -> dict[str, Row]:
    return json.loads((RESULTS / name).read_text(encoding="utf-8"))["policies"]


def _audit_cell(item: Row) -> str:
    text = audit_value(float("nan") if item["value"] is None else item["value"], item["unit"])
    return text if item["passed"] else f"**{text}**"


def _cell(value: float | None, digits: int = 2) -> str:
    return "-" if value is None else number(value, digits)


def _speed(value: float | None) -> str:
    return "-" if value is None else f"{number(value)} m/s"


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


if __name__ == "__main__":
    readme = RESULTS.parent / "README.md"
    readme.write_text(readme_with_rows(readme.read_text(encoding="utf-8")), encoding="utf-8")
