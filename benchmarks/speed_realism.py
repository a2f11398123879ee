"""Speed against realism: what trained policies hold, and what it costs them in energy, steps and shocks.

    python benchmarks/speed_realism.py E0=runs/e0/policy.onnx P2=runs/p2/policy.onnx --workers 2
    python benchmarks/speed_realism.py          # draws the stored trials anew

One trial of the profile with its 10 s hold a policy and command: nominal robot, outdoors, raw command. Trials
are kept in results/speed_realism/trials.json by the name given and the SHA-256 of the file; those that are
there are not run again. The figure has every trial that ran to the end at half its command or more as a
point, a line a policy. Squares are what later trainings recorded of theirs in results/*-looks, where none of
their runs fell; stars are other seeds of the shipped recipe. What is filled passes every line of the audit,
and the front is drawn through the best of that.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from harness import EVALUATION_PACKAGES, answer, circumstances
from matplotlib.axes import Axes
from second_engine import digest, rounded

from sprintlab.control import POLICY_RATE_HZ, load_policy
from sprintlab.core.errors import InvalidValueError
from sprintlab.core.files import atomic_write_json
from sprintlab.core.theme import LIGHT, figure_legend, save_figure, set_title, themed_figure
from sprintlab.evaluation.audit import AuditThresholds
from sprintlab.evaluation.pool import TrialPool
from sprintlab.evaluation.results import TrialResult
from sprintlab.evaluation.trial import TrialRequest
from sprintlab.robots import load_robot

COMMANDS = (9.0, 10.0, 11.0, 12.0, 13.0)
_SPEEDS = ("speed_m_s", "held_raw_m_s", "held_m_s")
RESULT, FIGURE = Path("results/speed_realism/trials.json"), Path("docs/images/speed-realism.png")
MEASURES = {
    "cost_of_transport": ("cost of transport", 1.0),
    "stride_frequency_Hz": ("strides a second [Hz]", 1.0),
    "stance_ms": ("median stance [ms]", -1.0),
    "foot_force_body_weights": ("foot force [body weights]", 1.0),
}
"""What the figure shows over the speed: label, which way is good."""
OTHER_NAMES = {"stride_frequency_Hz": "stride_Hz", "foot_force_body_weights": "foot force"}
"""What some looks call these measures."""
_ROUNDS = ("EFG", "ABC", "W", "PQ", "R", "S", "Y", "s")
_LABELS = (
    "E, F, G",
    "A, B, C: range of commands ahead",
    "W: E0 goes on",
    "P, Q: standing held, speed rewarded",
    "R: ramps and slopes",
    "S: R1 goes on, longer at the top",
    "Y: R and S with another seed",
    "sprint",
)
_COLORS = (LIGHT.speed, "#98a2b3", "#12855b", "#d64545", "#7a5af8", "#e07b00", "#0b8a9e", LIGHT.foreground)
ROUNDS = {
    letter: (label, color)
    for letters, label, color in zip(_ROUNDS, _LABELS, _COLORS, strict=True)
    for letter in letters
}
"""Label and colour of a policy by the first letter of its name."""


def row_of(trial: TrialResult) -> dict[str, Any]:
    """What one trial tells; ``None`` where it fell before it could be told."""
    found, audit = trial.metrics, {item.name: item.value for item in trial.audit.items}
    facts = {
        "command_m_s": trial.top_speed,
        "fall": trial.fall_reason,
        "speed_m_s": found.held_speed,
        "cost_of_transport": found.cost_of_transport,
        "stride_frequency_Hz": found.stride_frequency,
        "stance_ms": 1e3 * found.stance_time,
        "foot_force_body_weights": audit["foot force"],
        "gear_torque_peak": audit["gear torque"],
        "failed": [item.name for item in trial.audit.items if not item.passed],
    }
    told: dict[str, Any] = rounded(facts)
    return told


def measure(path: Path, commands: list[float], workers: int) -> list[dict[str, Any]]:
    """One trial a command."""
    robot = load_robot(load_policy(path).contract.robot_name)
    with TrialPool(path, robot, workers=workers) as pool:
        return [row_of(trial) for trial in pool.trials([TrialRequest(top_speed=each) for each in commands])]


def collect(chosen: argparse.Namespace) -> dict[str, Any]:
    """Trials of all policies, those stored and those asked for; draws them."""
    found = json.loads(RESULT.read_text(encoding="utf-8")) if RESULT.exists() else {"policies": {}}
    for name, path in chosen.policies:
        known = found["policies"].get(name, {})
        sha = digest(path)
        trials = known.get("trials", []) if known.get("sha256") == sha else []
        missing = sorted(set(chosen.commands) - {trial["command_m_s"] for trial in trials})
        if missing:
            trials = sorted(trials + measure(path, missing, chosen.workers), key=_command)
            found["policies"][name] = {"sha256": sha, "trials": trials}
            found |= circumstances(EVALUATION_PACKAGES)
            atomic_write_json(RESULT, found)
    draw(found, FIGURE)
    return found


def _command(trial: dict[str, Any]) -> float:
    return float(trial["command_m_s"])


@dataclass(frozen=True)
class Look:
    """What one group of later trainings recorded.

    Attributes:
        label: in the legend.
        color: in the figure.
        parts: which looks, and which part of each, tell of policies that have no trial of their own here.
        marker: in the figure.
    """

    label: str
    color: str
    parts: tuple[tuple[str, str], ...]
    marker: str = "s"

    def points(self, results: Path = Path("results")) -> list[dict[str, Any]]:
        """Each a speed, those of ``MEASURES`` that were written down, and the lines of the audit that failed.

        Falls are left out, and speeds below the slowest command: asked for 13 m/s, those stumble.
        """
        found = [
            point
            for look, part in self.parts
            for point in _recorded(_read(results / f"{look}-looks/trainings.json")[part])
        ]
        return [point for point in found if point["speed_m_s"] >= min(COMMANDS)]


SEEDS = Look("sprint's other seeds", LIGHT.foreground, (("ninth", "seeds"), ("tenth", "seeds")), "*")
LOOKS = (
    Look("means of R and S, of Y", "#667085", (("fourth", "races"), ("fifth", "races"))),
    Look("F, G, H: fast goes on, their means", "#c026d3", (("sixth", "means"), ("sixth", "races"))),
    Look(
        "I, J, K: softer, their means",
        "#65a30d",
        (("seventh", "means"), ("seventh", "races_on_another_processor")),
    ),
    Look("L, M, N, O: for turns, their means", "#a16207", (("eighth", "means"),)),
    Look(
        "V: braking; other shares, paces",
        "#0ea5e9",
        (("ninth", "other_shares"), ("ninth", "braking_practised"), ("ninth", "pace_of_sprint_fast")),
    ),
    Look(
        "one thing left out",
        "#f472b6",
        (("tenth", "left_out"), ("eleventh", "left_out"), ("twelfth", "left_out")),
    ),
    Look(
        "recipe of sprint with a battery",
        "#dc2626",
        (
            ("eleventh", "with_battery"),
            ("twelfth", "with_battery"),
            ("twelfth", "other_means"),
            ("thirteenth", "with_battery"),
            ("thirteenth", "other_means"),
        ),
        "*",
    ),
    Look(
        "battery in its first half; softer feet",
        "#0d9488",
        (
            ("thirteenth", "second_halves"),
            ("thirteenth", "softer_feet"),
            ("thirteenth", "shares_of_the_fastest"),
            ("fourteenth", "second_halves"),
            ("fourteenth", "fifth_trainings"),
            ("fourteenth", "shares_of_seed_2"),
            ("fifteenth", "shares_of_seed_2"),
            ("fifteenth", "same_shares_of_other_seeds"),
        ),
    ),
    SEEDS,
)
"""All that was trained after the policies with trials of their own, and means of those."""


def _read(path: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return found


def _recorded(part: Any) -> Iterator[dict[str, Any]]:
    """The points in a part of a look, however deep they stand."""
    if isinstance(part, list):
        part = dict(enumerate(part))
    if not isinstance(part, dict):
        return
    speed = next((part[name] for name in _SPEEDS if name in part), None)
    if speed is not None and not part.get("falls"):
        yield {"speed_m_s": float(speed), "failed": part.get("failed"), **_measures(part)}
    elif not any(name in part for name in _SPEEDS):
        for inner in part.values():
            yield from _recorded(inner)


def _measures(row: dict[str, Any]) -> dict[str, float]:
    """Those of ``MEASURES`` that a row has, by whichever name and in whichever unit."""
    told = {**row.get("worst", {}), **row}
    found = {name: told.get(name, told.get(OTHER_NAMES.get(name, name))) for name in MEASURES}
    if "stance_s" in told:
        found["stance_ms"] = 1e3 * told["stance_s"]
    return {name: value for name, value in found.items() if value is not None}


def bounds(stored: dict[str, Any]) -> dict[str, float]:
    """Of each of ``MEASURES``: a limit of the audit, or the goal that is stored with the trials."""
    limits = {"stance_ms": 1e3 / POLICY_RATE_HZ, "foot_force_body_weights": AuditThresholds().foot_force}
    return {**stored["goals"], **limits}


def draw(stored: dict[str, Any], path: Path) -> None:
    """A panel a measure: policies with trials, later looks, and in black the front and the first edition."""
    figure, axes = themed_figure(LIGHT, (12.0, 7.6), 2, 2)
    policies, later = stored["policies"], [(look, look.points()) for look in LOOKS]
    good = passing(policies) + [point for _, points in later for point in points if point["failed"] == []]
    for panel, (measured, (label, sign)) in zip(axes, MEASURES.items(), strict=True):
        for name, row in policies.items():
            _draw_policy(panel, name, row["trials"], measured)
        for look, points in later:
            _draw_look(panel, look, points, measured)
        panel.plot(*_line(front(_pairs(good, measured), sign)), color=LIGHT.foreground, lw=1.2, label="front")
        old = _pairs(stored["first_edition"], measured)
        panel.plot(*_line(old), "x", color=LIGHT.foreground, label="first edition")
        panel.axhline(bounds(stored)[measured], color=LIGHT.muted, lw=0.8, ls=":")
        panel.set_xlabel("speed held [m/s]")
        set_title(panel, label, LIGHT)
    handles, labels = axes[0].get_legend_handles_labels()
    once = dict(zip(labels, handles, strict=True))
    figure_legend(figure, LIGHT, list(once.values()), columns=4)
    save_figure(path, figure, dpi=90)


def _pairs(rows: list[dict[str, Any]], measured: str) -> list[tuple[float, float]]:
    """Speed and measure of the rows that have it."""
    return [(row["speed_m_s"], row[measured]) for row in rows if measured in row]


def _line(points: list[tuple[float, float]]) -> tuple[list[float], list[float]]:
    return [point[0] for point in points], [point[1] for point in points]


def _draw_look(panel: Axes, look: Look, points: list[dict[str, Any]], measured: str) -> None:
    large = look.marker == "*"
    style = {"ls": "", "ms": 9.0 if large else 3.0, "color": look.color, "zorder": 4.0 if large else 1.0}
    panel.plot([], [], look.marker, label=look.label, **style)
    for point in points:
        fill = look.color if point["failed"] == [] else "none"
        panel.plot(*_line(_pairs([point], measured)), look.marker, mfc=fill, mew=0.7, alpha=0.8, **style)


def passing(policies: dict[str, Any]) -> list[dict[str, Any]]:
    """The trials that passed every line of the audit."""
    trials = [trial for row in policies.values() for trial in row["trials"]]
    return [trial for trial in trials if not trial["fall"] and not trial["failed"]]


def runs(trial: dict[str, Any]) -> bool:
    """Upright to the end, and not so slow that it has stumbled: at least half the commanded speed is held."""
    return not trial["fall"] and (trial["speed_m_s"] or 0.0) >= 0.5 * trial["command_m_s"]


def front(points: list[tuple[float, float]], sign: float) -> list[tuple[float, float]]:
    """Points that no other beats in speed and measure; ``sign`` is 1 where a small measure is good."""
    found: list[tuple[float, float]] = []
    for point in sorted(points, reverse=True):
        if not found or sign * point[1] < sign * found[-1][1]:
            found.append(point)
    return found


def _draw_policy(panel: Axes, name: str, trials: list[dict[str, Any]], measured: str) -> None:
    label, color = ROUNDS[name[0]]
    upright = [trial for trial in trials if runs(trial)]
    speeds = [trial["speed_m_s"] for trial in upright]
    panel.plot(speeds, [trial[measured] for trial in upright], color=color, lw=0.6, alpha=0.6)
    panel.plot([], [], "o", ms=4, color=color, label=label)
    for trial in upright:
        fill = "none" if trial["failed"] else color
        panel.plot(trial["speed_m_s"], trial[measured], "o", ms=4, color=color, mfc=fill)


def _policies(words: list[str]) -> Iterator[tuple[str, Path]]:
    for word in words:
        name, separator, path = word.partition("=")
        if not separator or name[:1] not in ROUNDS or not Path(path).is_file():
            allowed = f"NAME=FILE, the name beginning with one of {', '.join(ROUNDS)}"
            raise InvalidValueError("policies", word, allowed)
        yield name, Path(path)


def parse() -> argparse.Namespace:
    """The arguments."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("policies", nargs="*", default=[], help="NAME=FILE; only draws when left out")
    parser.add_argument("--commands", nargs="+", type=float, default=list(COMMANDS), help="[m/s]")
    parser.add_argument("--workers", type=int, default=1, help="processes")
    parser.add_argument("--output", type=Path, help="also write JSON there")
    parser.add_argument("--json", action="store_true", help="print JSON only")
    chosen = parser.parse_args()
    chosen.policies = list(_policies(chosen.policies))
    return chosen


def show(result: dict[str, Any]) -> None:
    """The fastest trial of each policy that passes every line."""
    for name, row in result["policies"].items():
        passed = [trial["speed_m_s"] for trial in passing({name: row})]
        print(name, f"{max(passed):.2f} m/s passes" if passed else "no trial passes")


if __name__ == "__main__":
    raise SystemExit(answer(parse, collect, show))
