"""The study's figure: the speed of every seed, by method."""

from __future__ import annotations

import io

from matplotlib.figure import Figure

from sprintlab.core.theme import DARK, LIGHT, Theme
from studies.paper.paper import PAPER_TABLE
from studies.paper.record import Runs
from studies.paper.statistics import interquartile_mean


def speeds_figure(runs: Runs) -> dict[str, bytes]:
    """PNG images, light under ``""`` and dark under ``"-dark"``."""
    return {"": _draw(runs, LIGHT), "-dark": _draw(runs, DARK)}


def _draw(runs: Runs, theme: Theme) -> bytes:
    figure = Figure(figsize=(8.0, 3.4), layout="constrained", facecolor=theme.background)
    axes = figure.subplots()
    axes.set_facecolor(theme.background)
    styles = (
        ("sprintlab", theme.speed, "our reward", -0.15),
        ("paper", theme.second, "the paper's reward", 0.15),
    )
    for preset, color, label, shift in styles:
        for place, method in enumerate(PAPER_TABLE):
            speeds = [run.running() for run in runs.get((preset, method), ())]
            if not speeds:
                continue
            name = label if place == 0 else None
            axes.scatter([place + shift] * len(speeds), speeds, s=18, color=color, label=name, zorder=3)
            mean = interquartile_mean(speeds).center
            axes.plot([place + shift - 0.12, place + shift + 0.12], [mean, mean], color=color, linewidth=2)
    for place, row in enumerate(PAPER_TABLE.values()):
        if row.max_velocity is not None:
            name = "reported in the paper" if place == 0 else None
            axes.scatter(place, row.max_velocity, marker="x", color=theme.foreground, label=name, zorder=4)
    names = [method.replace("-", "\n", 1) for method in PAPER_TABLE]
    axes.set_xticks(range(len(PAPER_TABLE)), names, color=theme.foreground)
    axes.set_ylabel("speed held [m/s]", color=theme.foreground)
    axes.set_ylim(bottom=0.0)
    axes.tick_params(colors=theme.foreground)
    axes.grid(axis="y", color=theme.grid)
    for spine in axes.spines.values():
        spine.set_color(theme.grid)
    legend = figure.legend(loc="outside upper center", ncols=3, frameon=False)
    for text in legend.get_texts():
        text.set_color(theme.foreground)
    image = io.BytesIO()
    figure.savefig(image, format="png", dpi=110, metadata={"Software": None})
    return image.getvalue()
