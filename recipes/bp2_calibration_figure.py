"""Draw the calibration of the BP2 surrogate and the policies of the package beside their robots' limits.

    python recipes/bp2_calibration_figure.py

Reads results/speed_limit/bp2.json (recipes/calibrate_bp2.py) and results/speed_limit/robots.json.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from calibrate_bp2 import REFINED, RESULT, SIMPLIFIED_GAIN, SQUARE_GAIN, choice_of, key_of, rules
from matplotlib.axes import Axes

from sprintlab.core.theme import LIGHT, axis_legend, save_figure, set_title, themed_figure
from sprintlab.robots.surrogate import EDITIONS

POLICIES, FIGURE = Path("results/speed_limit/robots.json"), Path("docs/images/bp2-calibration.png")
COLORS = (*LIGHT.legs, LIGHT.second, LIGHT.speed, LIGHT.muted, LIGHT.foreground)


def draw(cells: dict[str, Any], path: Path) -> None:
    """The map and the policies of the package under the limits of their robots."""
    figure, axes = themed_figure(LIGHT, (12.0, 3.9), 1, 3)
    _draw_map(axes[0], cells)
    _draw_gains(axes[1], cells)
    _draw_policies(axes[2])
    save_figure(path, figure, dpi=90)


def _rows(cells: dict[str, Any]) -> dict[float, list[tuple[float, dict[str, Any]]]]:
    """Cells with the knee gear, springs and legs of the choice: hip gear and cell, by stack."""
    rows: dict[float, list[tuple[float, dict[str, Any]]]] = {}
    for key in cells:
        choice = choice_of(key)
        if (choice.knee_gear, choice.spring, choice.leg) == (7.0, 800.0, 1.0):
            rows.setdefault(choice.stack, []).append((choice.hip_gear, cells[key]))
    return {stack: sorted(row, key=lambda item: item[0]) for stack, row in sorted(rows.items())}


def _draw_map(axes: Axes, cells: dict[str, Any]) -> None:
    for color, (stack, row) in zip(COLORS, _rows(cells).items(), strict=False):
        gears, speeds = [gear for gear, _ in row], [cell["limits"]["refined"]["speed"] for _, cell in row]
        axes.plot(gears, speeds, color=color, label=f"stack {stack:g}")
        for gear, cell in row:
            fill = color if all(rules(cell).values()) else "none"
            axes.plot(gear, cell["limits"]["refined"]["speed"], "o", color=color, mfc=fill)
    chosen = EDITIONS["bp2"]
    speed = cells[key_of(chosen)]["limits"]["refined"]["speed"]
    axes.plot(chosen.hip_gear, speed, "*", ms=15, color=LIGHT.foreground, label="bp2")
    axes.axhline(REFINED, color=LIGHT.muted, ls="--")
    axes.set(xlabel="gear ratio of the hip", ylabel="refined limit [m/s]")
    set_title(axes, "Limit by stack of the motors", LIGHT)
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
    for place, row in enumerate(rows.values()):
        axes.barh(place, row["limit_m_s"], color=LIGHT.muted, alpha=0.4)
        for index, (policy, speed) in enumerate(row["policies"].items()):
            axes.plot(speed, place, "o", color=LIGHT.speed)
            text, shift = f"{policy} {speed:.2f}", (-4, 7 - 18 * index)
            axes.annotate(text, (speed, place), shift, textcoords="offset points", ha="right", fontsize=7)
    axes.set_yticks(range(len(rows)), [f"{name}\n{row['strides']}" for name, row in rows.items()])
    axes.set(xlabel="limit (bar) and policies (dots) [m/s]")
    set_title(axes, "Robots, limits, policies", LIGHT)


def main() -> None:
    """Draw the picture of docs/speed-limit.md."""
    draw(json.loads(RESULT.read_text(encoding="utf-8"))["cells"], FIGURE)


if __name__ == "__main__":
    main()
