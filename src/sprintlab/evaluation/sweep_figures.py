"""Pictures of sweeps: robustness, the turning map, a lap seen from above."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from sprintlab.commands import KERB_DISTANCE, LANE_WIDTH, Track
from sprintlab.core.theme import (
    LIGHT,
    as_written,
    axis_legend,
    figure_legend,
    labelled,
    set_title,
    themed_figure,
)
from sprintlab.evaluation.figures import recorded
from sprintlab.evaluation.results import TrialResult
from sprintlab.evaluation.robustness import ALL
from sprintlab.evaluation.sweep import Run, held_speeds, of_group
from sprintlab.evaluation.turning import largest_yaw_rate


def robustness_figure(summary: dict[str, Any], runs: Sequence[Run], title: str) -> Figure:
    """Held speed of all sprints as a distribution, and what each cause costs by itself.

    ``summary`` is what ``summarize`` gave of the runs; the title names policy and command.
    """
    figure, axes = themed_figure(LIGHT, (10.0, 3.8), 1, 2)
    figure.suptitle(as_written(title), fontweight="bold", color=LIGHT.foreground)
    _draw_speeds(axes[0], summary, runs)
    _draw_causes(axes[1], summary)
    return figure


def _draw_speeds(axis: Axes, summary: dict[str, Any], runs: Sequence[Run]) -> None:
    """Share of all sprints that stay upright and hold at least a speed; it starts at the share upright."""
    together = of_group(runs, ALL)
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
    falls = [row["trials"] - row["upright"] for row in rows]
    labels = [
        f"{row['change_m_s']:+.2f}" + (f", {fell} of {row['trials']} fell" if fell else "")
        for row, fell in zip(rows, falls, strict=True)
    ]
    axis.bar_label(bars, labels, padding=3, fontsize=7, color=LIGHT.foreground)
    axis.invert_yaxis()
    axis.margins(x=0.35)
    axis.grid(visible=False, axis="y")
    axis.axvline(0.0, color=LIGHT.muted, linewidth=0.8)
    axis.set(xlabel="change of the mean held speed [m/s]")
    set_title(axis, "What each cause costs by itself", LIGHT)


def turning_figure(numbers: dict[str, Any]) -> Figure:
    """Commanded turns as circles, achieved ones as dots joined to them; what friction allows is shaded."""
    figure, (axis,) = themed_figure(LIGHT, (7.0, 4.6), 1, 1)
    asked = np.array([(t["command_speed_m_s"], t["command_yaw_rate_rad_s"]) for t in numbers["turns"]])
    speed = np.linspace(min(0.0, *asked[:, 0]), 1.05 * max(1.0, *np.abs(asked[:, 0])), 200)
    bound = np.array([largest_yaw_rate(value) for value in speed])
    axis.fill_between(speed, -bound, bound, color=LIGHT.shade, label="allowed by friction, at most 1 rad/s")
    achieved = np.array([(t["speed_m_s"], t["yaw_rate_rad_s"]) for t in numbers["turns"]], dtype=float)
    fell = np.isnan(achieved).any(axis=1)
    axis.plot(*np.stack((asked, achieved)).transpose(2, 0, 1), color=LIGHT.muted, linewidth=0.8)
    for places, look, label in (
        (asked, {"marker": "o", "mfc": "none", "color": LIGHT.command, "markersize": 7}, "commanded"),
        (achieved, {"marker": "o", "color": LIGHT.speed, "markersize": 4}, "achieved, mean over 2 s"),
        (asked[fell], {"marker": "x", "color": LIGHT.on_limit, "markersize": 7}, "fell"),
    ):
        if len(places):
            axis.plot(*places.T, linestyle="", label=label, **look)
    axis.set(xlabel="forward speed [m/s]", ylabel="yaw rate [rad/s], left is positive")
    set_title(axis, "Turning: achieved and commanded", LIGHT)
    figure_legend(figure, LIGHT, labelled(axis))
    return figure


def lap_figure(trial: TrialResult) -> Figure:
    """The path of the trunk and lane 1, from above; axes in metres."""
    motion = recorded(trial)
    figure, (axis,) = themed_figure(LIGHT, (8.0, 4.8), 1, 1)
    line = Track()
    for outward in (-KERB_DISTANCE, LANE_WIDTH - KERB_DISTANCE):
        axis.plot(*_oval(line, outward).T, color=LIGHT.muted, linewidth=0.7)
    places = motion.qpos[:, :2] - motion.qpos[0, :2]
    axis.plot(*places.T, color=LIGHT.speed, linewidth=1.2, label="path of the trunk")
    axis.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    set_title(axis, "One lap in lane 1, anticlockwise from (0, 0)", LIGHT)
    axis_legend(axis, LIGHT, loc="center")
    return figure


def _oval(track: Track, outward: float) -> NDArray[np.float64]:
    """A closed line at a distance outside the measured one ``(n, 2)`` [m]."""
    radius, angle = track.radius + outward, np.linspace(0.0, np.pi, 100)
    bend = np.stack((radius * np.sin(angle), track.radius - radius * np.cos(angle)), axis=-1)
    back = np.array([-track.straight, 2.0 * track.radius]) - bend
    return np.concatenate((bend, back, bend[:1]))
