"""The picture of a robustness study."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sprintlab.core.theme import LIGHT, as_written, axis_legend, set_title, themed_figure
from sprintlab.evaluation.robustness.draws import ALL
from sprintlab.evaluation.robustness.study import Piece
from sprintlab.evaluation.robustness.summary import held_speeds


def robustness_figure(summary: dict[str, Any], pieces: Sequence[Piece], title: str) -> Figure:
    """Held speed of all sprints as a distribution, and what each cause costs by itself.

    Args:
        summary: of ``summarize``.
        pieces: the sprints.
        title: policy and command.
    """
    figure, axes = themed_figure(LIGHT, (10.0, 3.8), 1, 2)
    figure.suptitle(as_written(title), fontweight="bold", color=LIGHT.foreground)
    _draw_speeds(axes[0], summary, pieces)
    _draw_causes(axes[1], summary)
    return figure


def _draw_speeds(axis: Axes, summary: dict[str, Any], pieces: Sequence[Piece]) -> None:
    """Share of all sprints that stay upright and hold at least a speed; it starts at the share upright."""
    together = [piece for piece in pieces if piece["group"] == ALL]
    speeds = np.sort(held_speeds(together))
    share = 100.0 * np.arange(len(speeds), 0, -1) / max(1, len(together))
    axis.step(speeds, share, where="pre", color=LIGHT.speed, label="everything at once")
    nominal = summary["nominal"]["held_speed_m_s"]
    if nominal is not None:
        axis.axvline(nominal, color=LIGHT.second, linestyle="--", label="nominal robot, mean")
    low, high = (100.0 * bound for bound in summary["interval_95"])
    axis.axhspan(low, high, color=LIGHT.envelope, label="share upright, 95 % interval")
    axis.set(xlabel="held speed [m/s]", ylabel="of all sprints [%]", ylim=(0.0, 105.0))
    upright = f"{summary['upright']} of {summary['trials']} sprints upright"
    set_title(axis, f"{upright}: how many hold at least a speed", LIGHT)
    axis_legend(axis, LIGHT, fontsize=7, loc="lower left")


def _draw_causes(axis: Axes, summary: dict[str, Any]) -> None:
    rows = [row for row in summary["causes"] if row["change_m_s"] is not None]
    names = [row["cause"] for row in rows]
    bars = axis.barh(names, [row["change_m_s"] for row in rows], color=LIGHT.speed)
    labels = [
        f"{row['change_m_s']:+.2f}"
        + (
            f", {row['trials'] - row['upright']} of {row['trials']} fell"
            if row["upright"] < row["trials"]
            else ""
        )
        for row in rows
    ]
    axis.bar_label(bars, labels, padding=3, fontsize=7, color=LIGHT.foreground)
    axis.invert_yaxis()
    axis.margins(x=0.35)
    axis.grid(visible=False, axis="y")
    axis.axvline(0.0, color=LIGHT.muted, linewidth=0.8)
    axis.set(xlabel="change of the mean held speed [m/s]")
    set_title(axis, "What each cause costs by itself", LIGHT)
