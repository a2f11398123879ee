"""Draw the calibration of the BP2 surrogate and the policies of the package beside their robots' limits.

    python recipes/bp2_calibration_figure.py

Reads results/speed_limit/bp2.json (recipes/calibrate_bp2.py), results/speed_limit/robots.json and the races
below results.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from bp2_editions import EDITIONS
from calibrate_bp2 import KNEE_GEARS as STACKS
from calibrate_bp2 import REFINED, RESULT, SIMPLIFIED_GAIN, SQUARE_GAIN, choice_of, key_of, rules
from matplotlib import colormaps
from matplotlib.axes import Axes

from sprintlab.core.theme import LIGHT, axis_legend, save_figure, set_title, themed_figure
from sprintlab.speed_limit import trained_speeds

KNEE_GEARS = {1.2: 8.0, 1.25: 7.75, 1.3: 7.25}
"""Smallest gear of the map with which the knee has 2.5 N m per kg; 7 for the other stacks."""
POLICIES, FIGURE = Path("results/speed_limit/robots.json"), Path("docs/images/bp2-calibration.png")
COLORS = [colormaps["viridis"](share) for share in np.linspace(0.0, 0.85, len(STACKS))]
_OFFSET = {"textcoords": "offset points"}


def draw(cells: dict[str, Any], path: Path) -> None:
    """The map and the policies of the package under the limits of their robots."""
    figure, axes = themed_figure(LIGHT, (12.0, 3.9), 1, 3)
    _draw_map(axes[0], cells)
    _draw_gains(axes[1], cells)
    _draw_policies(axes[2])
    save_figure(path, figure, dpi=90)


def _rows(cells: dict[str, Any]) -> dict[float, list[tuple[float, dict[str, Any]]]]:
    """Cells with springs and legs of the choice and the smallest knee gear that rule 3 allows: by stack."""
    rows: dict[float, list[tuple[float, dict[str, Any]]]] = {}
    for key in cells:
        choice = choice_of(key)
        nominal = replace(EDITIONS["bp2"], stack=choice.stack, hip_gear=choice.hip_gear)
        if choice == replace(nominal, knee_gear=KNEE_GEARS.get(choice.stack, 7.0)):
            rows.setdefault(choice.stack, []).append((choice.hip_gear, cells[key]))
    return {stack: sorted(row, key=lambda item: item[0]) for stack, row in sorted(rows.items())}


def _draw_map(axes: Axes, cells: dict[str, Any]) -> None:
    for color, (stack, row) in zip(COLORS, _rows(cells).items(), strict=False):
        gears, speeds = [gear for gear, _ in row], [cell["limits"]["refined"]["speed"] for _, cell in row]
        axes.plot(gears, speeds, color=color)
        axes.annotate(f"{stack:g}", (gears[0], speeds[0]), (-6, -3), ha="right", fontsize=8, **_OFFSET)
        for gear, cell in row:
            fill = color if all(rules(cell).values()) else "none"
            axes.plot(gear, cell["limits"]["refined"]["speed"], "o", color=color, mfc=fill)
    chosen = EDITIONS["bp2"]
    speed = cells[key_of(chosen)]["limits"]["refined"]["speed"]
    axes.plot(chosen.hip_gear, speed, "*", ms=15, color=LIGHT.speed, label="bp2")
    axes.axhline(REFINED, color=LIGHT.muted, ls="--")
    axes.set_xlim(7.38, 8.55)
    axes.set(xlabel="gear ratio of the hip", ylabel="refined limit [m/s]")
    set_title(axes, "Limit by stack (filled: all rules hold)", LIGHT)
    axis_legend(axes, LIGHT)


def _draw_gains(axes: Axes, cells: dict[str, Any]) -> None:
    for color, (stack, row) in zip(COLORS, _rows(cells).items(), strict=False):
        for model, style in (("simplified-dc", ":"), ("square", "-")):
            gains = [
                100.0 * (cell["limits"][model]["speed"] / cell["limits"]["refined"]["speed"] - 1.0)
                for _, cell in row
            ]
            label = f"{model}, stack {stack:g}" if stack == EDITIONS["bp2"].stack else None
            axes.plot([gear for gear, _ in row], gains, style, marker=".", color=color, label=label)
    for gain in (SIMPLIFIED_GAIN, SQUARE_GAIN):
        axes.axhline(100.0 * gain, color=LIGHT.muted, ls="--")
    axes.set(xlabel="gear ratio of the hip", ylabel="above the refined limit [%]")
    set_title(axes, "What other motor models promise", LIGHT)
    axis_legend(axes, LIGHT)


def _draw_policies(axes: Axes) -> None:
    rows = json.loads(POLICIES.read_text(encoding="utf-8"))["robots"]
    for place, (robot, row) in enumerate(rows.items()):
        axes.barh(place, row["limit_m_s"], color=LIGHT.muted, alpha=0.4)
        for item in trained_speeds(Path("results"), robot):
            axes.plot(item.speed, place, "o", color=LIGHT.speed)
            text, found = f"{item.policy} {item.speed:.2f}", (item.speed, place)
            axes.annotate(text, found, (-4, 7), textcoords="offset points", ha="right", fontsize=7)
    axes.set_yticks(range(len(rows)), [f"{name}\n{row['strides']}" for name, row in rows.items()])
    axes.set(xlabel="limit (bar) and policies (dots) [m/s]")
    set_title(axes, "Robots, limits, policies", LIGHT)


def main() -> None:
    """Draw the picture of docs/speed-limit.md."""
    draw(json.loads(RESULT.read_text(encoding="utf-8"))["cells"], FIGURE)


if __name__ == "__main__":
    main()
