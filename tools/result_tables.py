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
README_ROWS = re.compile(r"(\| the paper, BP2 \| treadmill[^\n]*\n).*?(\| Margolis)", re.DOTALL)
"""Our rows stand between the paper's last row and the first of its peers."""
Row = dict[str, Any]


def tables() -> dict[str, str]:
    """Every table by the name under which a page asks for it: ``{{ name }}``."""
    policies = _read("robustness/first-edition.json")
    engines = list(_read("second_engine/speeds.json").values())
    return {
        "policy_summary": policy_summary(policies, engines),
        "policy_audit": policy_audit(policies),
        "robustness": robustness(policies),
        "second_engine": second_engine(engines),
        "second_looks": second_looks(_read("second-looks/trainings.json")),
    }


def policy_summary(policies: dict[str, Row], engines: Sequence[Row]) -> str:
    """The first screen: speed, second engine, 100 m, upright, audit."""
    drake = {row["policy"]: row["drake"]["held_speed_m_s"] for row in engines}
    head = ("", "command", "held, MuJoCo", "held, Drake", "100 m", "upright", "audit")
    rows = []
    for name, row in policies.items():
        failed = sum(not item["passed"] for item in row["audit"])
        audit = f"**{failed} of {len(row['audit'])} lines fail**" if failed else "passed"
        speeds = (held(row, False), _speed(drake.get(name)))
        rows.append((f"`{name}`", f"{row['command_m_s']:g} m/s", *speeds, time(row), upright(row), audit))
    return _table(head, rows)


def policy_audit(policies: dict[str, Row]) -> str:
    """Every line of the audit, a column a policy; what fails is bold."""
    columns = list(policies.values())
    lines: list[tuple[str, Callable[[Row], str]]] = [
        ("held, raw", lambda row: held(row, False)),
        ("held, self-paced", lambda row: held(row, True)),
        ("still rising by", lambda row: f"{_cell(row['hold_acceleration_m_s2'])} m/s²"),
        ("stride frequency", lambda row: f"{_cell(row['stride_frequency_Hz'], 1)} Hz"),
        ("duty factor", lambda row: _cell(row["duty"], 3)),
        ("cost of transport", lambda row: _cell(row["cost_of_transport"])),
    ]
    rows = [(label, *(text(row) for row in columns)) for label, text in lines]
    for items in zip(*(row["audit"] for row in columns), strict=True):
        limit = audit_limit(AuditItem(**items[0], note=""))
        rows.append((f"{items[0]['name']}: {limit}", *map(_audit_cell, items)))
    return _table(("", *(f"`{name}`" for name in policies)), rows)


def robustness(policies: dict[str, Row]) -> str:
    """Shares upright and quantiles of the held speed."""
    head = ("policy", "upright (95 % interval)", "held: 5 / 50 / 95 % hold less", "nominal robot")
    rows = []
    for name, row in policies.items():
        rows.append((f"`{name}`", upright(row), f"{quantiles(row)} m/s", held(row, False)))
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


def second_looks(trainings: Row) -> str:
    """Speed, estimate and stop of trainings that are not shipped."""
    head = (
        "",
        "what",
        "speed at a command of 10 m/s",
        "at 12",
        "bias of the estimate at 10",
        "at 12",
        "stance at 12",
        "self-paced from 12: left after 5 s",
    )
    rows = []
    for name, row in trainings.items():
        trials = {(trial["self_paced"], trial["command_m_s"]): trial for trial in row["trials"]}
        ten, twelve, paced = trials[False, 10.0], trials[False, 12.0], trials[True, 12.0]
        cells = (
            name,
            row["what"],
            _speed(ten["speed_m_s"]),
            _speed(twelve["speed_m_s"]),
            f"{ten['estimate_bias_m_s']:+.2f}",
            f"{twelve['estimate_bias_m_s']:+.2f}",
            f"{twelve['stance_ms']:.0f} ms",
            _speed(abs(paced["speed_after_1_to_6_s_m_s"][4])),
        )
        rows.append(cells)
    return _table(head, rows)


def readme_rows(name: str = DEFAULT_POLICY) -> str:
    """The rows of one policy for the README's table, an engine each, between its two marks."""
    policy = _read("robustness/first-edition.json")[name]
    engines = next(row for row in _read("second_engine/speeds.json").values() if row["policy"] == name)
    failed = sum(not item["passed"] for item in policy["audit"])
    audit = f"**{failed} of {len(policy['audit'])} audit lines fail**" if failed else "audit passed"
    rows = []
    for engine, label in (("mujoco", "MuJoCo"), ("drake", "Drake")):
        found = engines[engine]
        who = f"ours, `{name}`: {audit}" if engine == "mujoco" else "the same policy file"
        where = f"{label}, {found['falls']} of {found['trials']} trials fell"
        rows.append((who, where, _speed(found["held_speed_m_s"]), f"{_cell(found['sprint_time_s'])} s"))
    return "\n".join(f"| {' | '.join(cells)} |" for cells in rows)


def readme_with_rows(text: str) -> str:
    """The README with the committed numbers in its table."""
    return README_ROWS.sub(lambda match: match[1] + readme_rows() + "\n" + match[2], text)


def time(row: Row) -> str:
    """Time over 100 m, with its mark."""
    if row["time_100m_s"] is None:
        return "not finished"
    return f"{number(row['time_100m_s'])} s" + (", left its lane" if row["left_lane"] else "")


def held(row: Row, paced: bool) -> str:
    """How the profile with the 10 s hold ended."""
    suffix = "_self_paced" if paced else ""
    if row[f"fell{suffix}"]:
        return f"fell ({row[f'fell{suffix}']})"
    speed = _speed(row[f"held_speed{suffix}_m_s"])
    return speed if row[f"stopped{suffix}"] else f"{speed}, did not stop"


def upright(row: Row) -> str:
    """Sprints without a fall, with their interval."""
    found = row["robustness"]
    lower, upper = (100 * bound for bound in found["interval_95"])
    return f"{found['upright']} of {found['trials']} ({lower:.0f} to {upper:.0f} %)"


def quantiles(row: Row) -> str:
    """Held speeds [m/s] that 5, 50 and 95 % of the sprints stay below."""
    found = row["robustness"]["held_speed_quantiles_m_s"]
    return " / ".join(_cell(found[name], 1) for name in ("0.05", "0.5", "0.95"))


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
