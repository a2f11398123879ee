"""Speed against realism: what trained policies hold, and what it costs them in energy, steps and shocks.

    python benchmarks/speed_realism.py E0=runs/e0/policy.onnx P2=runs/p2/policy.onnx --workers 2
    python benchmarks/speed_realism.py          # draws the stored trials anew

One trial of the profile with its 10 s hold a policy and command: nominal robot, outdoors, raw command. Trials
are kept in results/speed_realism/trials.json by the name given and the SHA-256 of the file; those that are
there are not run again. The figure has every trial that ran to the end at half its command or more as a
point, a line a policy; filled points pass every line of the audit, and the front is drawn through the best
of them. Small crosses are what later looks recorded of theirs in results/*-looks: means of networks, other
seeds of the recipe, terms left out; most of them are the worst of 22 runs.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from harness import EVALUATION_PACKAGES, answer, circumstances
from matplotlib.axes import Axes
from second_engine import digest, rounded

from sprintlab.control import load_policy
from sprintlab.core.errors import InvalidValueError
from sprintlab.core.files import atomic_write_json
from sprintlab.core.theme import LIGHT, figure_legend, save_figure, set_title, themed_figure
from sprintlab.evaluation.pool import TrialPool
from sprintlab.evaluation.results import TrialResult
from sprintlab.evaluation.trial import TrialRequest
from sprintlab.robots import load_robot

COMMANDS = (9.0, 10.0, 11.0, 12.0, 13.0)
LATER = {
    "fourth": ("races",),
    "fifth": ("races",),
    "sixth": ("means",),
    "eighth": ("means",),
    "ninth": ("seeds", "other_shares", "braking_practised"),
    "tenth": ("seeds", "left_out"),
}
"""Which part of which looks tells of policies that have no trial of their own here."""
_SPEEDS = ("speed_m_s", "held_raw_m_s", "held_m_s")
RESULT, FIGURE = Path("results/speed_realism/trials.json"), Path("docs/images/speed-realism.png")
MEASURES = {
    "cost_of_transport": ("cost of transport", 0.8, 1.0),
    "stride_frequency_Hz": ("strides a second [Hz]", 5.5, 1.0),
    "stance_ms": ("median stance [ms]", 20.0, -1.0),
    "foot_force_body_weights": ("foot force [body weights]", 4.0, 1.0),
}
"""What the figure shows over the speed: label, bound of audit or goal, which way is good."""
FIRST_EDITION = ((13.41, 1.164, 7.14, 18.0, 5.45), (14.09, 1.325, 7.14, 18.0, 5.53))
"""Speed and these measures of policies that have left the package, on their robot and today's plant."""
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
    draw(found["policies"], FIGURE)
    return found


def _command(trial: dict[str, Any]) -> float:
    return float(trial["command_m_s"])


def later_points(looks: Path = Path("results")) -> list[dict[str, Any]]:
    """What later looks recorded, each a speed and those of ``MEASURES`` that were written down.

    Slower ones than the slowest command are left out: asked for 13 m/s, they stumble.
    """
    found = []
    for name, parts in LATER.items():
        whole = json.loads((looks / f"{name}-looks/trainings.json").read_text(encoding="utf-8"))
        found += [point for part in parts for point in _recorded(whole[part])]
    return [point for point in found if point["speed_m_s"] >= min(COMMANDS)]


def _recorded(part: Any) -> Iterator[dict[str, Any]]:
    """The points in a part of a look, however deep they stand."""
    if isinstance(part, list):
        part = dict(enumerate(part))
    if not isinstance(part, dict):
        return
    speed = next((part[name] for name in _SPEEDS if isinstance(part.get(name), float)), None)
    if speed is None:
        for inner in part.values():
            yield from _recorded(inner)
        return
    worst = part.get("worst", {})
    told = {"foot_force_body_weights": worst.get("foot force"), **part, "speed_m_s": speed}
    yield {name: told[name] for name in ("speed_m_s", *MEASURES) if told.get(name) is not None}


def draw(policies: dict[str, Any], path: Path) -> None:
    """A panel a measure: every policy a line over its speeds, coloured by round; the front in black."""
    figure, axes = themed_figure(LIGHT, (12.0, 6.4), 2, 2)
    for place, (panel, (measured, (label, bound, sign))) in enumerate(
        zip(axes, MEASURES.items(), strict=True)
    ):
        for name, row in policies.items():
            _draw_policy(panel, name, row["trials"], measured)
        later = [(point["speed_m_s"], point[measured]) for point in later_points() if measured in point]
        panel.plot(
            *zip(*later, strict=True),
            "+",
            ms=4,
            color=LIGHT.muted,
            label="means, other seeds, terms left out",
        )
        points = [(trial["speed_m_s"], trial[measured]) for trial in passing(policies)]
        panel.plot(*zip(*front(points, sign), strict=True), color=LIGHT.foreground, lw=1.2, label="front")
        old = [(values[0], values[1 + place]) for values in FIRST_EDITION]
        panel.plot(*zip(*old, strict=True), "x", color=LIGHT.foreground, label="first edition")
        panel.axhline(bound, color=LIGHT.muted, lw=0.8, ls=":")
        panel.set_xlabel("speed held [m/s]")
        set_title(panel, label, LIGHT)
    handles, labels = axes[0].get_legend_handles_labels()
    once = dict(zip(labels, handles, strict=True))
    figure_legend(figure, LIGHT, list(once.values()), columns=4)
    save_figure(path, figure, dpi=90)


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
